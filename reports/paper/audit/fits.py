"""What the fits say: which extensions the tables support, and which they cannot tell apart."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from reports.paper import compare, reproduction
from reports.paper.audit.finding import Finding, finding, span
from reports.paper.compare import LOADS, Comparison
from reports.paper.fitting import repeatability
from reports.paper.model import table_circuit
from reports.paper.vocabulary import UNSEEN


def _with(group: Sequence[Comparison], parameter: str) -> Comparison:
    """The first comparison that frees a parameter."""
    return next(c for c in group if parameter in c.fit.candidate.free)


def _last_freed(group: Sequence[Comparison], parameter: str) -> Comparison:
    """The comparison that adds a parameter and nothing after it."""
    return next(c for c in group if c.fit.candidate.free[-1:] == (parameter,))


def error_before_and_after() -> Finding:
    """What the extension gains."""
    literal, before, after = (
        reproduction.error(results)
        for results in (reproduction.per_cycle(), reproduction.summed(), reproduction.extended())
    )
    tables = {
        f"table_{name.lower()}": [reproduction.error(r, name) for r in (reproduction.summed(), reproduction.extended())]
        for name in ("I", "II", "III", "IV")
    }
    peaks = {f"peaks_{name.lower()}": _mean_peak_error(name) for name in ("I", "II")}
    best = compare.extended()
    return finding(
        "fit-before-and-after",
        after < 0.2 * before and best.left_out < 2 * after,
        literal=literal,
        before=before,
        factor_before=float(np.exp(before)),
        after=after,
        closed_form=best.fit.rms,
        left_out=best.left_out,
        parameters=len(best.fit.candidate.free),
        numbers_compared=best.fit.residuals.size,
        scatter=repeatability(),
        **tables,
        **peaks,
    )


def _mean_peak_error(table: str) -> float:
    """Relative error of the extended model's peak powers in a table, mean of the logarithms."""
    return float(np.expm1(np.mean([np.log(c.ratios[1]) for c in reproduction.extended() if c.row.table == table])))


def loss_in_the_fits() -> Finding:
    """Leakage or slow polarisation."""
    group = compare.electrical()
    without, leak, slow = _last_freed(group, "force_750"), _with(group, "leak"), _with(group, "slow_capacitance")
    label = min(_with(group, f"load_{n}").left_out for n in (1, 2, 3))
    total = slow.fit.parameters["capacitance"] + slow.fit.parameters["slow_capacitance"]
    return finding(
        "fit-loss-beside-the-load",
        max(leak.left_out, slow.left_out) < 0.7 * min(without.left_out, label),
        without=without.left_out,
        leak=leak.left_out,
        slow=slow.left_out,
        wrong_label=label,
        leak_kohm=1e-3 * leak.fit.parameters["leak"],
        slow_s=slow.fit.parameters["slow_time"],
        slow_total_uF=1e6 * total,
        slow_over_table_v=total / table_circuit().capacitance,
    )


def open_choices() -> Finding:
    """Which choices that the paper leaves open predict left-out rows."""
    near = sorted(compare.plausible(), key=lambda c: c.left_out)
    starts = {(c.fit.candidate.choice.sine_from, c.fit.candidate.choice.step_from) for c in near}
    words = ", ".join(
        f"{'leak' if 'leak' in c.fit.candidate.free else 'polarisation'} with the sines on "
        f"{LOADS[c.fit.candidate.choice.sine_load]} {c.left_out:.3f}"
        for c in near
    )
    one_set = [fit.rms for fit in compare.extended_by_load()]
    return finding(
        "fit-open-choices",
        starts == {(100.0, 0.0)} and one_set[1] == min(one_set),
        near=words,
        worst=max(c.left_out for c in compare.choices()),
        one_set=one_set,
    )


def coupling_and_capacitance() -> Finding:
    """Ranges of T/k and C over everything that predicts about equally well."""
    found = [c.fit.parameters for c in compare.plausible()]
    nominal = table_circuit()
    voltage = span(p["charge"] / p["capacitance"] for p in found)
    charge = span(p["charge"] for p in found)
    own = nominal.charge / nominal.capacitance
    return finding(
        "fit-coupling-and-capacitance",
        voltage[0] > 1.5 * own and charge[1] > 1.5 * charge[0],
        explanations=len(found),
        voltage_mV_per_N=[1e3 * value for value in voltage],
        over_table_v=[value / own for value in voltage],
        charge_nC_per_N=[1e9 * value for value in charge],
        table_v_nC_per_N=1e9 * nominal.charge,
        capacitance_uF=span(1e6 * p["capacitance"] for p in found),
        table_v_uF=1e6 * nominal.capacitance,
    )


def hysteresis_in_the_fits() -> Finding:
    """The published hysteresis in either reading."""
    none = _with(compare.electrical(), "leak").fit
    stop, play = (c.fit for c in compare.hysteretic())
    return finding(
        "fit-hysteresis",
        min(stop.rms, play.rms) > 1.2 * none.rms,
        none=none.rms,
        stop=stop.rms,
        play=play.rms,
        play_nC_per_N=1e9 * play.parameters["charge"],
        play_uF=1e6 * play.parameters["capacitance"],
        loop_share=_loop_share(),
    )


def _loop_share() -> float:
    """Net over gross mechanical energy of the simulated sine at 1 kN, 1 Hz."""
    place = ("IV", 1000.0, 1.0)
    run = next(c.simulated for c in reproduction.per_cycle() if (c.row.table, c.row.force, c.row.frequency) == place)
    return run.cycle.mechanical_net / run.cycle.mechanical_gross


def joint_in_the_fits() -> Finding:
    """A joint that seats, a Hertzian one, or stiffening."""
    group = compare.mechanical()
    linear = _last_freed(group, "stiffness")
    seat, hertz, cubic = (_with(group, name) for name in ("seat", "hertz", "cubic"))
    return finding(
        "fit-joint",
        seat.left_out < min(hertz.left_out, cubic.left_out, linear.left_out),
        linear=linear.left_out,
        cubic=cubic.left_out,
        hertz=hertz.left_out,
        hertz_all=hertz.fit.rms,
        seat=seat.left_out,
        seat_um=1e6 * seat.fit.parameters["seat"],
        seat_N=seat.fit.parameters["seat_force"],
        seat_k=1e-8 * seat.fit.parameters["stiffness"],
    )


def every_effect() -> Finding:
    """What each effect of the vocabulary does for left-out rows, alone and beside leak and joint."""
    (base, whole), tried = compare.before_effects(), compare.vocabulary()
    alone = {t.effect.name: t.alone.left_out / base.left_out - 1 for t in tried}
    beside = {t.effect.name: t.beside.left_out / whole.left_out - 1 for t in tried if t.beside}
    return finding(
        "fit-vocabulary",
        min(alone, key=lambda name: alone[name]) == "contact_compliance" and min(beside.values()) > -0.2,
        effects=len(tried) + len(UNSEEN),
        fitted=len(tried),
        base=base.left_out,
        whole=whole.left_out,
        alone=_gains(alone),
        beside=_gains(beside),
        clip_V=next(t.beside.fit.parameters["clip"] for t in tried if t.beside and t.effect.name == "clipping"),
    )


def _gains(changes: dict[str, float]) -> str:
    """Effects that lower the error on left-out rows by two per cent or more, the best first, in words."""
    lower = sorted((change, name.replace("_", " ")) for name, change in changes.items() if change < -0.02)
    return ", ".join(f"{name} by {-change:.0%}" for change, name in lower) or "none"


CHECKS = (
    error_before_and_after,
    loss_in_the_fits,
    coupling_and_capacitance,
    hysteresis_in_the_fits,
    joint_in_the_fits,
    every_effect,
    open_choices,
)
