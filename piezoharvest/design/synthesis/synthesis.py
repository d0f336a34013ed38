"""Synthesised networks of a design, and what each restriction on them costs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from piezoharvest.design.drafts import Draft
from piezoharvest.design.linear_view import LinearView
from piezoharvest.design.parts.rounding import RoundedParts
from piezoharvest.design.parts.series import series_of
from piezoharvest.design.result import Bound
from piezoharvest.design.synthesis.growth import Growth
from piezoharvest.design.synthesis.ladder import LOAD, ladder_class, names_of
from piezoharvest.design.synthesis.measure import LadderMeasure
from piezoharvest.design.synthesis.view import LadderView
from piezoharvest.design.tuning.minimax import tune
from piezoharvest.design.tuning.region import COIL_QUALITY, SPAN, Region
from piezoharvest.design.tuning.starts import Host, Start
from piezoharvest.linear import resonances

ORDER = 4  # where the study does not say: beyond it, another coil and capacitor bring 1 to 2 %
ORDERS = (2, 4, 6)  # whose figures are compared
SERIES = "E24"  # of the parts whose price is told where the study names no series
FORMULA = "ladder grown arm by arm"


@dataclass
class Synthesis:
    """Synthesis of ladders for a transducer in its operation.

    Attributes
    ----------
    view : LinearView
        With hysteresis at the charge amplitude of its linearisation.
    host : Host
    """

    view: LinearView
    host: Host
    _growths: dict[float, Growth] = field(default_factory=dict)
    _tuned: dict[tuple[int, float], Draft] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.options = self.view.goal.options
        self.order = self.options.order or ORDER
        self.ladders = LadderView.of(self.view)

    @property
    def draft(self) -> Draft:
        """The network of the order and with the coils that the study asks for, its values optimal on the two-port."""
        op, quality = self.view.operation, self.options.coil_quality
        if self.view.goal.damping and op.apart and op.band is None:
            quality = quality or COIL_QUALITY  # ideal coils would cancel the displacement at the one frequency whole
        return self._at(self.order, quality)

    def restrictions(self) -> tuple[Mapping[str, Any], ...]:
        """Figures on the two-port with ideal coils in rising order, then with real coils, then with preferred values.

        Mappings with `name`, `order`, `coil_quality` (None: ideal), `parts` (None: any value) and the objective's
        figure, `harvested_power` in W or `attenuation_db`.
        """
        order, quality = self.order, self.options.coil_quality or COIL_QUALITY
        series = self.options.parts or SERIES
        rows = [self._row(f"order {n}", self._at(n, None), n) for n in sorted({*ORDERS, order})]
        real = self._at(order, quality)
        rows.append(self._row(f"order {order}, coils of quality {quality:g}", real, order, quality))
        bought = self._bought(real, series)
        name = f"order {order}, coils of quality {quality:g}, {series} parts"
        return (*rows, self._row(name, bought, order, quality, series))

    def _row(
        self, name: str, draft: Draft, order: int, quality: float | None = None, parts: str | None = None
    ) -> Mapping[str, Any]:
        figures, damping = self.ladders.figures(draft.shunt), self.view.goal.damping
        key = "attenuation_db" if damping else "harvested_power"
        return {"name": name, "order": order, "coil_quality": quality, "parts": parts, key: getattr(figures, key)}

    def _at(self, order: int, quality: float | None) -> Draft:
        """Tuned ladder of at most an order, with coils of a quality at the centre, or without losses (None)."""
        loss = self.host.omega / quality if quality else 0.0
        if (order, loss) not in self._tuned:
            grown = self._growth(loss).best(order)
            names = (*names_of(grown.arms), LOAD)
            first: dict[str, Any] = dict(zip(names, map(float, np.exp(grown.logs)), strict=True))
            draft = Draft(ladder_class(grown.arms, loss)(**first), names, formula=FORMULA)
            tuned = tune(self.ladders, draft, Start(FORMULA, first), self._region(draft))
            self._tuned[order, loss] = Draft(tuned.shunt, names, formula=FORMULA)
        return self._tuned[order, loss]

    def _growth(self, loss: float) -> Growth:
        """Growth of ladders with coils of some loss, ohm per henry."""
        if loss not in self._growths:
            impedance = 1 / (self.host.omega * self.host.capacitance)
            limit = self.options.max_inductance or np.inf
            self._growths[loss] = Growth(self._measure, self._places, impedance, loss, float(SPAN), limit)
        return self._growths[loss]

    @cached_property
    def _measure(self) -> LadderMeasure:
        return LadderMeasure.of(self.view)

    @property
    def _places(self) -> tuple[float, ...]:
        """The centre and the resonances of other modes that are driven, rad/s."""
        found, lines = resonances(self.view.transducer), self.view.operation.frequencies
        middle = np.sqrt(found.short_circuit.undamped * found.open_circuit.undamped)
        driven = 2 * np.pi * middle[(middle > np.min(lines)) & (middle < np.max(lines))]
        apart = np.abs(np.log(driven / self.host.omega)) > 0.01
        return (self.host.omega, *map(float, driven[apart]))

    def _region(self, draft: Draft) -> Region:
        return Region.of(draft, self.host, self.options.max_inductance)

    def _bought(self, draft: Draft, series: str) -> Draft:
        """The draft with the best preferred values."""
        goal, region = self.view.goal, self._region(draft)
        rounding = RoundedParts(draft, series_of(series), self.ladders, self.ladders, region, goal, lambda: True)
        return Draft(draft.with_values(rounding.run()), draft.free, formula=FORMULA)


def bounded(restrictions: tuple[Mapping[str, Any], ...] | None, bound: Bound) -> tuple[Mapping[str, Any], ...] | None:
    """Restrictions with the bound, under which there is none but passivity and causality, in front."""
    if not restrictions:
        return restrictions
    key = "harvested_power" if "harvested_power" in restrictions[0] else "attenuation_db"
    value = getattr(bound, key)
    first = {"name": "bound", "order": None, "coil_quality": None, "parts": None, key: value}
    return restrictions if value is None else (first, *restrictions)
