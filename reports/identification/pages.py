"""Table, figure and JSON of the coverage."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from scipy.stats import norm

from piezoharvest.output import write_text
from piezoharvest.report.figures import style

GOAL, LIMIT = 0.95, 3.0


def deviations(rows: list[dict]) -> dict[str, np.ndarray]:
    """Errors in units of the standard error, by parameter."""
    names = [name for name, one in rows[0]["parameters"].items() if any(r["parameters"][name]["std"] for r in rows)]
    return {
        name: np.array(
            [(p["value"] - p["truth"]) / p["std"] for p in (row["parameters"][name] for row in rows) if p["std"]]
        )
        for name in names
    }


def write(rows: list[dict], folder: Path, long: dict | None) -> None:
    """Write coverage.png, identification.md and identification.json."""
    z = deviations(rows)
    style.write_png(_figure(z), folder / "coverage.png")
    summary = {
        name: {
            "specimens": len(v),
            "mean": v.mean(),
            "std": v.std(ddof=1),
            "within_3": float(np.mean(np.abs(v) < LIMIT)),
            "largest": float(np.abs(v).max()),
        }
        for name, v in z.items()
    }
    before = (
        json.loads((folder / "identification.json").read_text()) if (folder / "identification.json").exists() else {}
    )
    result = {
        "specimens": len(rows),
        "converged": sum(row["converged"] for row in rows),
        "coverage": summary,
        "cpu_median": float(np.median([row["cpu"] for row in rows])),
        "wall_median": float(np.median([row["wall"] for row in rows])),
        "long_record": long or before.get("long_record"),
    }
    write_text(json.dumps(result, indent=2) + "\n", folder / "identification.json")
    write_text(_page(result), folder / "identification.md")


def _page(result: dict) -> str:
    lines = [
        "# Identification\n",
        f"{result['specimens']} random specimens on the virtual bench, each with a campaign like the paper's "
        "(designs/paper_campaign): "
        "every parameter is drawn within 30 % of its nominal value, eight records of 10 s at 1 kHz, three loads, steps "
        f"and sines. {result['converged']} fits converged; a fit takes {result['cpu_median']:.2g} s of CPU time "
        "(median). Written by `python -m reports.identification`.\n",
        "![errors in units of the standard error](coverage.png)\n",
        "| parameter | within 3 standard errors | mean of z | standard deviation of z | largest |",
        "|---|---:|---:|---:|---:|",
        *(
            f"| {name} | {100 * row['within_3']:.1f} % | {row['mean']:+.2f} | {row['std']:.2f} | {row['largest']:.2f} |"
            for name, row in result["coverage"].items()
        ),
        "\nz is (estimate - truth) / standard error. The mass is not identifiable in any of them: "
        "the resonance is at 22 kHz.\n",
    ]
    long = result["long_record"]
    if long:
        text = f"A record of {long['samples']:,} samples, four channels, is read, checked and fitted"
        lines.append(
            f"{text} in {long['memory'] / 2**30:.2f} GiB of memory and {long['cpu']:.0f} s of CPU time, "
            f"ten minutes at 10 kHz; no parameter is more than {long['off']:.1f} standard errors off. Measured by "
            "`python -m reports.identification --long`.\n"
        )
    return "\n".join(lines)


@style.styled
def _figure(z: dict[str, np.ndarray]):
    rows = -(-len(z) // 3)
    figure, axes = style.grid_of_axes(rows, 3, height=1.7 * rows + 0.4, sharex=True, squeeze=False)
    edges, fine = np.linspace(-5, 5, 26), np.linspace(-5, 5, 200)
    for one, (name, values) in zip(axes.flat, z.items(), strict=False):
        one.hist(np.clip(values, -5, 5), edges, density=True, color=style.PALETTE[5])
        one.plot(fine, norm.pdf(fine), color=style.INK, linewidth=1.0)
        one.axvspan(-LIMIT, LIMIT, color=style.PALETTE[2], alpha=0.1, linewidth=0, zorder=0)
        one.set_title(f"{name}: {100 * np.mean(np.abs(values) < LIMIT):.1f} %", fontsize=8)
        one.set_yticks([])
    for one in axes.flat[len(z) :]:
        one.set_visible(False)
    for one in axes.flat[max(len(z) - 3, 0) : len(z)]:
        one.tick_params(labelbottom=True)
        one.set_xlabel("error in standard errors")
    return figure
