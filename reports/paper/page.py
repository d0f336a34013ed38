"""The page: what stands in it, and the files beside it."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup, escape

from piezoharvest.output import write_text
from piezoharvest.report.figures.pictures import Picture, place_pictures
from piezoharvest.report.frame.rendering import page
from piezoharvest.report.units import number
from reports.paper import beyond, compare, reproduction
from reports.paper.audit.finding import Finding
from reports.paper.compare import Comparison
from reports.paper.extended import extended_fit
from reports.paper.files import findings_json, rows_csv
from reports.paper.fitting import repeatability
from reports.paper.tables import experiment, paper

_UNITS = {
    "charge": ("T/k", 1e9, "nC/N"), "capacitance": ("C + T²/k", 1e6, "µF"), "stiffness": ("k", 1e-8, "·10⁸ N/m"),
    "leak": ("leak", 1e-3, "kΩ"), "slow_capacitance": ("slow C", 1e6, "µF"), "slow_time": ("slow time", 1.0, "s"),
    "rise_time": ("rise", 1e3, "ms"), "step_cycles": ("cycles, I", 1.0, ""), "stroke_cycles": ("cycles, III", 1.0, ""),
    "record": ("record", 1.0, "s"), "peak_factor": ("peaks ×", 1.0, ""), "force_750": ("force at 0.75 kN ×", 1.0, ""),
    "load_1": ("R1 ×", 1.0, ""), "load_2": ("R2 ×", 1.0, ""), "load_3": ("R3 ×", 1.0, ""),
    "hertz": ("Hertz", 1e9, "nm/N^(2/3)"), "seat": ("seat", 1e6, "µm"), "seat_force": ("seat force", 1.0, "N"),
    "cubic": ("cubic", 1e6, "1/kN²"), "beta_rising": ("β", 1e3, "·10⁻³/V²"), "beta_falling": ("−β", 1e3, "·10⁻³/V²"),
    "creep": ("share", 1.0, ""), "creep_time": ("time", 1.0, "s"), "friction": ("k_f/k", 1.0, ""),
    "friction_force": ("threshold", 1.0, "N"), "quadratic_rising": ("T₂/(T k)", 1e3, "1/kN"),
    "quadratic_falling": ("−T₂/(T k)", 1e3, "1/kN"), "drift": ("fall", 100.0, "%"), "bias": ("current", 1e6, "µA"),
    "lag": ("lag", 1e3, "ms"), "clip": ("limit", 1.0, "V"), "hum_voltage": ("on v", 1e3, "mV"),
    "hum_current": ("on i", 1e6, "µA"), "hum_displacement": ("on x", 1e9, "nm"),
}  # fmt: skip
_IN_IT = {"rms": "", "left_out": "", "parameters": "in it"}


def write_page(findings: dict[str, list[Finding]], pictures: Iterable[Picture], directory: Path) -> Path:
    """Write figures, rows, findings and, last, the page into a directory."""
    placed = place_pictures(pictures, ("page",), directory)["page"]
    figures = {figure["name"]: figure for figure in placed}
    write_text(rows_csv(), directory / "rows.csv")
    write_text(findings_json(findings), directory / "findings.json")
    content = {"marked": _marked, "figures": figures, **findings, **_content(findings)}
    write_text(page("page.html.j2", Path(__file__).parent, **content), directory / "index.html")
    return directory / "index.html"


def _marked(text: str) -> Markup:
    """Text with indices below the line and exponents above it."""
    lowered = re.sub(r"\b([A-Za-z])_([A-Za-z]+|\d)", r"\1<sub>\2</sub>", str(escape(text)))
    return Markup(re.sub(r"\^(\d[\d.]*\d|\d)", r"<sup>\1</sup>", lowered))


def _content(findings: dict[str, list[Finding]]) -> dict[str, Any]:
    """What the template fills in beside findings and figures."""
    p = extended_fit().parameters
    everything = [f for group in findings.values() for f in group]
    kinds = Counter(f.confidence for f in findings["audit"])
    return {
        "title": paper()["title"],
        "specimen": paper()["specimen"],
        "cards": _cards(len(everything)),
        "summary": _summary({f.name: f for f in everything}),
        "sine_load": f"{experiment()['loads_ohm'][1] / 1e3:g} kΩ",
        "step_cycles": f"{p['step_cycles']:.1f}",
        "stroke_cycles": f"{p['stroke_cycles']:.1f}",
        "rise_time": f"{p['rise_time'] * 1e3:.0f} ms",
        "tables": [_table(name) for name in ("I", "II", "III", "IV")],
        "errors": _errors(),
        "counts": f"{len(findings['audit'])} findings: {kinds['certain']} certain, {kinds['likely']} likely, "
        f"{kinds['undecidable']} that cannot be decided from the paper.",
        "repeatability": f"{repeatability():.1%}",
        "comparisons": [
            ("Tables I and II", [_comparison(c) for c in [*compare.electrical(), *compare.hysteretic()]]),
            ("Tables III and IV", [_comparison(c) for c in compare.mechanical()]),
            ("All four tables", [_comparison(compare.extended())]),
            ("Tables I and II, what the paper leaves open", [_choice(c) for c in compare.choices()]),
        ],
        "effects": _effects(),
        "interfaces": [interface.name for interface in beyond.INTERFACES],
        "harvest": _harvest(),
    }


def _cards(count_of_findings: int) -> list[tuple[str, str, str]]:
    before, after = reproduction.error(reproduction.summed()), reproduction.error(reproduction.extended())
    return [
        ("rows compared", str(len(reproduction.per_cycle())), "two printed numbers each"),
        ("findings", str(count_of_findings), "in findings.json"),
        ("Table V, summed", f"× {np.exp(before):.1f}", "typical error, rms of logarithms"),
        ("extended model", f"{after:.1%}", f"{len(extended_fit().candidate.free)} parameters for 96 numbers"),
        ("on rows left out", f"{compare.extended().left_out:.1%}", "a level, load or frequency at a time"),
    ]


def _summary(by_name: dict[str, Finding]) -> list[str]:
    """The claims that weigh most, with what they mean."""
    chosen = (
        "stiffness-agrees", "sums-over-a-record", "mechanical-energy-is-gross", "voltage-beyond-open-circuit",
        "fit-loss-beside-the-load",
        "displacement-is-not-the-specimens", "fit-hysteresis", "fit-before-and-after", "outlook-switching",
    )  # fmt: skip
    return [f"{by_name[name].claim} ({by_name[name].confidence})" for name in chosen]


def _milli(value: float) -> str:
    """In thousandths, three digits."""
    return f"{value * 1e3:#.3g}".rstrip(".")


def _table(name: str) -> dict[str, Any]:
    """Rows of a table as they are shown."""
    step = paper()["tables"][name]["excitation"] == "step"
    series = [
        [c for c in results if c.row.table == name]
        for results in (reproduction.per_cycle(), reproduction.summed(), reproduction.extended())
    ]
    shown, before = [], None
    for plain, total, extended in zip(*series, strict=True):
        row = plain.row
        energy, peak = (f"{v.text} ± {v.half * 1e3:g}" for v in (row.energy, row.peak))
        # The rise time makes a difference to peaks of steps only.
        peaks = (plain, total, extended) if step else (plain, extended)
        cells = [energy, *(_milli(c.energy) for c in (plain, total, extended)), peak, *(_milli(c.peak) for c in peaks)]
        second = f"{row.load / 1e3:g} kΩ" if row.load is not None else f"{row.frequency:g} Hz"
        first = row.force != before
        shown.append({"force": f"{row.force / 1e3:g} kN", "second": second, "cells": cells, "first": first})
        before = row.force
    caption = paper()["tables"][name]["caption"]
    return {"name": name, "caption": caption, "second": "load" if step else "frequency", "step": step, "rows": shown}


def _errors() -> list[tuple[str, list[str]]]:
    named = {
        "Table V, one cycle, as headed": reproduction.per_cycle(),
        "Table V, summed, stop reading": reproduction.summed(),
        "Table V, summed, play reading": reproduction.summed("play"),
        "Table V, summed, without hysteresis": reproduction.summed("none"),
        "extended": reproduction.extended(),
    }
    return [
        (name, [f"{reproduction.error(results, table):.2f}" for table in ("I", "II", "III", "IV", None)])
        for name, results in named.items()
    ]


def _comparison(c: Comparison) -> dict[str, Any]:
    """A fitted candidate as a line of its table."""
    return {
        "name": c.fit.candidate.name,
        "free": len(c.fit.candidate.free),
        "rms": f"{c.fit.rms:.3f}",
        "left_out": number(c.left_out, 2),
        "worst": c.worst,
        "chi": f"{c.fit.reduced_chi_squared:.1f}",
        "parameters": _parameters(c, c.fit.candidate.free),
    }


def _parameters(c: Comparison, names: Iterable[str]) -> str:
    """Fitted parameters in words."""
    parts = []
    for name in names:
        words, factor, unit = _UNITS[name]
        spread = c.fit.spread[name]
        known = f"± {spread:.0%}" if spread < 1 else "(not determined)"
        parts.append(f"{words} {c.fit.parameters[name] * factor:.3g} {unit}".strip() + f" {known}")
    return "; ".join(parts)


def _effects() -> dict[str, Any]:
    """The effects of the vocabulary, alone and beside the extended model."""
    base, whole = compare.before_effects()
    lines = []
    for tried in compare.vocabulary():
        pairs = ((tried.alone, base), (tried.beside, whole))
        parts = [_part(found, before) if found else _IN_IT for found, before in pairs]
        verdict = _verdict(tried.beside, whole) if tried.beside else "in the extended model"
        if verdict == "not seen" and _verdict(tried.alone, base) != verdict:
            verdict = f"{_verdict(tried.alone, base)} alone; not beside leak and joint"
        lines.append({"name": tried.effect.name.replace("_", " "), "parts": parts, "verdict": verdict})
    before = {"base": base.fit.rms, "base_out": base.left_out, "whole": whole.fit.rms, "whole_out": whole.left_out}
    return {"lines": lines, **{name: f"{value:.3f}" for name, value in before.items()}}


def _part(found: Comparison, before: Comparison) -> dict[str, str]:
    added = [name for name in found.fit.candidate.free if name not in before.fit.candidate.free]
    return {
        "rms": f"{found.fit.rms:.3f}", "left_out": f"{found.left_out:.3f}", "parameters": _parameters(found, added)
    }  # fmt: skip


def _verdict(found: Comparison, before: Comparison) -> str:
    """Whether left-out rows ask for an effect."""
    added = set(found.fit.candidate.free) - set(before.fit.candidate.free)
    known = all(found.fit.spread[name] < 0.5 for name in added)
    share = found.left_out / before.left_out
    return "not seen" if share > 0.98 or not known else "perhaps" if share > 0.9 else "asked for"


def _choice(c: Comparison) -> dict[str, Any]:
    """The same, named by what it chooses."""
    chosen = c.fit.candidate.choice
    kind = "leak" if "leak" in c.fit.candidate.free else "polarisation"
    starts = f"sines from {chosen.sine_from / 1e3:g} kN, steps from {chosen.step_from / 1e3:g} kN"
    return {**_comparison(c), "name": f"{kind}, sines on {compare.LOADS[chosen.sine_load]}, {starts}"}


def _harvest() -> list[tuple[list[str], list[str]]]:
    lines = []
    for (name, frequency, drop), tuned in beyond.survey().tuned.items():
        cells = []
        for interface in beyond.INTERFACES:
            best = tuned[interface.name]
            value = {"ohm": f" ({best.value / 1e3:.1f} kΩ)", "V": f" ({best.value:.1f} V)", "": ""}[interface.tuned]
            cells.append(f"{best.power * 1e6:.0f} µW{value}" if best.converged else "not converged")
        lines.append(([name, f"{frequency:g} Hz", f"{drop:g} V"], cells))
    return lines
