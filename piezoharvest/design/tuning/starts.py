"""Closed-form start values for the tuning of linear shunts.

Sources: Hagood & von Flotow, J. Sound Vib. 146(2), 243-268, 1991 (resistor, transfer-function rule, pole placement);
Yamada, Matsuhisa, Utsuno & Sawada, J. Sound Vib. 329(24), 4980-4997, 2010 (near-H-infinity rule); Kong, Ha, Erturk &
Inman, J. Intell. Mater. Syst. Struct. 21(13), 1293-1302, 2010 (conjugate match of the load).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from piezoharvest.description.shunts import LinearShunt, Shunt
from piezoharvest.description.shunts.linear.negative_capacitance import NegativeCapacitance
from piezoharvest.design.drafts import Draft
from piezoharvest.design.linear_view import LinearView
from piezoharvest.design.places import owner, unit_at
from piezoharvest.design.tuning.branches import branch_values
from piezoharvest.linear import TwoPort, resonances


class Start(NamedTuple):
    """Start values, and the formula that they come from."""

    formula: str
    values: dict[str, float]


@dataclass(frozen=True)
class Host:
    """Properties of a transducer that the closed forms need, at the mode nearest to a frequency.

    Attributes
    ----------
    omega, short, opened : float
        The frequency, and the mode's short- and open-circuit resonance, rad/s.
    capacitance : float
        Clamped capacitance, F.
    coupling : float
        K^2 of the mode.
    impedance : complex
        Of the leads at `omega`, ohm.
    modes : tuple of (float, float)
        Short- and open-circuit resonances in the band, rad/s, the most strongly coupled first.
    beside : mapping of int to Host
        The same of further electrodes that have a shunt, by their numbers, all others being open.
    """

    omega: float
    short: float
    opened: float
    capacitance: float
    coupling: float
    impedance: np.complex128
    modes: tuple[tuple[float, float], ...] = ()
    beside: Mapping[int, Host] = field(default_factory=dict)

    @classmethod
    def of(cls, view: LinearView) -> Host:
        """Host at the centre of the view's operation."""
        host = cls._alone(view)
        if len(view.taken) == 1:
            return host
        bare = replace(view.transducer, hysteresis=None, effects=())  # which are not those of further electrodes
        views = {n: replace(view, transducer=bare.swapped(n), amplitude=None, taken=(0,)) for n in view.taken[1:]}
        return replace(host, beside={n: cls._alone(each) for n, each in views.items()})

    def at(self, shunt: Shunt, name: str) -> Host:
        """The host of the circuit that has a field by this name: of the others at their own electrodes."""
        return self.beside.get(owner(shunt, name)[0].electrode, self)

    @classmethod
    def _alone(cls, view: LinearView) -> Host:
        transducer = view.transducer
        frequency = view.operation.centre(transducer)
        found = resonances(transducer)
        n = int(np.argmin(np.abs(np.log(found.short_circuit.undamped / frequency))))
        short, opened = (2 * np.pi * r.undamped[n] for r in (found.short_circuit, found.open_circuit))
        with np.errstate(all="ignore"):
            impedance = np.complex128(TwoPort.of(transducer, frequency, amplitude=view.amplitude).impedance()[0])
        coupling = (opened**2 - short**2) / short**2
        modes = tuple(view.operation.modes(transducer))
        return cls(2 * np.pi * frequency, short, opened, view.capacitance, coupling, impedance, modes)


def starts(draft: Draft, host: Host) -> list[Start]:
    """Start values for the tuning of a linear shunt, those from specific formulas first."""
    if draft.formula:
        return [Start(draft.formula, draft.first())]
    own = {
        "resistor": _resistor, "series_rl": _series_rl, "parallel_rl": _parallel_rl, "series_rlc": _series_rlc,
        "parallel_rlc": _parallel_rlc, "negative_capacitance": _negative_capacitance,
    }.get(draft.kind)  # fmt: skip
    found = own(host, draft.shunt) if own else []
    given = branch_values(draft.shunt, host.modes, host.capacitance)
    found += [Start(formula, {name: values[name] for name in draft.free}) for formula, values in given]
    if not given:
        found.append(Start("impedance of the clamped capacitance", scales(draft, host)))
    return [s for s in found if all(np.isfinite(v) and v > 0 for v in s.values.values())]


def scales(draft: Draft, host: Host) -> dict[str, float]:
    """Typical value of every free part, by its unit: from the impedance of the capacitance at the frequency."""
    w, found = host.omega, {}
    for name in draft.free:
        c = host.at(draft.shunt, name).capacitance
        # A dc voltage is anything: from one volt the search region reaches from 0.1 mV to 10 kV.
        scale = {"ohm": 1 / (w * c), "H": 1 / (w**2 * c), "F": c, "V": 1.0, "rad": 0.0, "": 0.0}
        found[name] = scale[unit_at(draft.shunt, name)]
    return found


def _resistor(host: Host, _: LinearShunt) -> list[Start]:
    c, w = host.capacitance, host.omega
    fixed_point = np.sqrt((host.short**2 + host.opened**2) / 2)
    return [
        Start("R = |Z| of the leads", {"resistance": abs(host.impedance)}),
        Start("R = 1/(C w_F) (Hagood & von Flotow 1991)", {"resistance": 1 / (c * fixed_point)}),
        # Over a band that holds both resonances, each has an optimum that suits it.
        *(Start(f"R = {s:g}/(C w)", {"resistance": s / (c * w)}) for s in (0.1, 10.0)),
    ]


def _series_rl(host: Host, _: LinearShunt) -> list[Start]:
    c, k2, sc, oc = host.capacitance, host.coupling, host.short, host.opened
    share = 1 - sc**2 / oc**2
    return [
        *_matched(host, lambda z: {"inductance": -z.imag / host.omega, "resistance": z.real}),
        Start(
            "near-H-infinity rule (Yamada et al. 2010)",
            {"inductance": 1 / (c * oc**2), "resistance": np.sqrt(3 * share / (2 - share)) / (c * oc)},
        ),
        Start(
            "transfer-function rule (Hagood & von Flotow 1991)",
            {"inductance": 1 / (c * oc**2), "resistance": np.sqrt(2 * k2) / (1 + k2) / (c * sc)},
        ),
        Start(
            "pole placement (Hagood & von Flotow 1991)",
            {
                "inductance": 1 / (c * (sc * (1 + k2)) ** 2),
                "resistance": 2 * np.sqrt(k2 / (1 + k2) ** 3) / (c * sc),
            },
        ),
    ]


def _parallel_rl(host: Host, shunt: LinearShunt) -> list[Start]:
    def match(z: np.complex128) -> dict[str, float]:
        y = 1 / z
        return {"inductance": 1 / (host.omega * y.imag), "resistance": 1 / y.real}

    found = _matched(host, match)
    for formula, values in _rules(host, shunt):
        # The same impedance at the open-circuit resonance, as a parallel circuit.
        resistance, reactance = values["resistance"], host.opened * values["inductance"]
        square = resistance**2 + reactance**2
        parallel = {"inductance": square / reactance / host.opened, "resistance": square / resistance}
        found.append(Start(f"{formula}, as a parallel circuit", parallel))
    return found


def _series_rlc(host: Host, shunt: LinearShunt) -> list[Start]:
    found = []
    for ratio in (10.0, 1.0):
        capacitance = ratio * host.capacitance
        extra = 1 / (host.opened**2 * capacitance)
        found += [
            Start(
                f"{formula}, with C = {ratio:g} times the clamped one in series",
                {**values, "inductance": values["inductance"] + extra, "capacitance": capacitance},
            )
            for formula, values in _series_rl(host, shunt)[:2]
        ]
    return found


def _parallel_rlc(host: Host, shunt: LinearShunt) -> list[Start]:
    found = []
    for ratio in (0.1, 1.0, 10.0):
        capacitance = ratio * host.capacitance
        susceptance = host.opened**2 * capacitance
        found += [
            Start(
                f"{formula}, with C = {ratio:g} times the clamped one beside it",
                {**values, "inductance": 1 / (1 / values["inductance"] + susceptance), "capacitance": capacitance},
            )
            for formula, values in _parallel_rl(host, shunt)[:2]
        ]
    return found


def _negative_capacitance(host: Host, shunt: LinearShunt) -> list[Start]:
    assert isinstance(shunt, NegativeCapacitance)
    c, c_n = host.capacitance, shunt.capacitance
    if shunt.topology == "parallel":
        left = c - c_n
        w_f = host.short * np.sqrt(1 + 0.5 * host.coupling * c / left) if left > 0 else np.nan
        return [Start("R = 1/((C - C_n) w_F) (K^2 raised by C/(C - C_n))", {"resistance": 1 / (left * w_f)})]
    return [Start("R = (1/C - 1/C_n)/w", {"resistance": (1 / c - 1 / c_n) / host.omega})]


def _rules(host: Host, shunt: LinearShunt) -> list[Start]:
    """The series-RL rules that are not impedance matching."""
    return [start for start in _series_rl(host, shunt) if not start.formula.startswith("conjugate")]


def _matched(host: Host, parts) -> list[Start]:
    """Load equal to the conjugate of the source impedance, where it can be made of positive parts."""
    with np.errstate(all="ignore"):
        values = parts(host.impedance)
    return [Start("conjugate match of the leads (Kong et al. 2010)", values)] if min(values.values()) > 0 else []
