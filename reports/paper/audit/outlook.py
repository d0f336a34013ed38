"""What the paper leaves for later, as far as the model can say."""

from __future__ import annotations

from reports.paper import beyond
from reports.paper.audit.finding import Finding, finding, span


def best_load() -> Finding:
    """The best resistor against the paper's."""
    survey, gains, best_at_five, words = beyond.survey(), [], [], []
    for name in beyond.devices():
        slow, fast = (survey.tuned[name, f, 0.0]["resistor"] for f in (1.0, 5.0))
        paper = survey.paper_load[name, 5.0]
        gains.append(fast.power / paper)
        best_at_five.append(1e-3 * fast.value)
        words.append(
            f"{name}: {slow.value / 1e3:.1f} kΩ at 1 Hz ({slow.power * 1e6:.0f} μW), {fast.value / 1e3:.1f} kΩ at 5 Hz "
            f"({fast.power * 1e6:.0f} μW, R2 gives {paper * 1e6:.0f} μW)"
        )
    return finding(
        "outlook-best-load", min(gains) > 2, best_kohm=span(best_at_five), gain=span(gains), words="; ".join(words)
    )


def switching() -> Finding:
    """Whether SSHI pays at 1 to 5 Hz against the drops."""
    survey, drop = beyond.survey(), beyond.SCHOTTKY
    at = {(name, f): survey.tuned[name, f, drop] for name in beyond.devices() for f in (1.0, 5.0)}
    over = [best["parallel SSHI"].power / best["resistor"].power for best in at.values()]
    spare = {n: at[n, 1.0]["parallel SSHI"].power - at[n, 1.0]["resistor"].power for n in beyond.devices()}
    kept = {
        kind: span(
            survey.against_drops[name, 500.0][kind][-1] / survey.against_drops[name, 500.0][kind][0]
            for name in beyond.devices()
        )
        for kind in ("rectifier", "parallel SSHI")
    }
    trusted = all(best[kind].converged for best in at.values() for kind in best)
    return finding(
        "outlook-switching",
        trusted and min(over) > 1.2 and all(best["rectifier"].power < best["resistor"].power for best in at.values()),
        drop_V=drop,
        large_drop_V=beyond.DROPS[-1],
        over_resistor=span(over),
        inductance_mH=1e3 * beyond.INDUCTANCE,
        quality=beyond.QUALITY,
        words=", ".join(f"{value * 1e6:.0f} μW ({name})" for name, value in spare.items()),
        rectifier_kept=kept["rectifier"],
        sshi_kept=kept["parallel SSHI"],
    )


def cycle_limit() -> Finding:
    """What the force cycle could give."""
    survey, share, per_volt, voltages = beyond.survey(), [], [], []
    for name, one in beyond.devices().items():
        best = survey.tuned[name, 5.0, 0.0]["parallel SSHI"]
        per_volt.append(beyond.power_per_volt(one, 1000.0, 5.0))
        share.append(best.power / (per_volt[-1] * best.voltage_amplitude))
        voltages.append(best.voltage_amplitude)
    return finding(
        "outlook-cycle-limit",
        min(share) > 0.3 and max(share) <= 1.0,
        uW_per_V=[1e6 * value for value in per_volt],
        share=span(share),
        voltage_V=span(voltages),
    )


CHECKS = (best_load, switching, cycle_limit)
