"""Formulas compared with a table on the table's own terms: the kinks that stand for one, with their covariance."""

from __future__ import annotations

import numpy as np

from piezoharvest.description.effects import DiodeDropError
from piezoharvest.description.effects.nameless.circuit_places import Diode
from piezoharvest.description.effects.nameless.forms import Bends, Corners, Form
from piezoharvest.description.effects.nameless.places import Place, Reading
from piezoharvest.description.transducer import Transducer
from piezoharvest.diagnose.discovery.law_fits import OWN, LawFit
from piezoharvest.diagnose.discovery.tables.knots import pieces_of
from piezoharvest.predict.parameters import Path, value_at

GAP = 10.0  # times the median distance of two samples: more is between two records
SAMPLES = 400  # inputs at which formula and table are compared
CURVE_SAMPLES = 60  # the same of two formulas, which have no corners
CURVE_UNIT = 1e-3  # of a curve's size: what one formula may be from another that stands for it


def drop_path(transducer: Transducer, place: Place) -> Path:
    """Path of the free drop of diodes, beside a voltage of theirs; empty where their label is trusted."""
    effects = transducer.effects if isinstance(place, Diode) else ()
    return next((("effects", n, "diode_drop") for n, e in enumerate(effects) if isinstance(e, DiodeDropError)), ())


def spread_inputs(table: LawFit, count: int = SAMPLES) -> np.ndarray:
    """Inputs at which forms of a law are compared with a table: where the records were, and evenly over that range."""
    x = np.quantile(table.visited, np.linspace(0.0, 1.0, count))
    if table.place.input == "campaign_time":  # between the records nothing is known
        return np.unique(x)
    return np.unique(np.concatenate([x, np.linspace(x[0], x[-1], count)]))


def recorded(times: np.ndarray) -> tuple[float, float]:
    """Length of what records cover of a time, without what lies between them, and the distance of two samples."""
    steps = np.diff(np.unique(times))
    sample = float(np.median(steps))
    return float(steps[steps < GAP * sample].sum()), sample


class Distance:
    """Distance of a formula from a table, in units of the table's covariance.

    Attributes
    ----------
    samples : float
        Number of samples that the table was fitted to.
    x : (n,) array
        Inputs at which formula and table are compared.
    whitened : (k, n) array
        Kinks that stand for the values of a function at the inputs, whitened.
    found : (k,) array
        Kinks of the table, whitened.
    with_constant : bool
        A constant beside the function is free.
    most_line : float
        Slope of a straight line that leaves nothing of the model's own parameter there: beside a formula with more, a
        stiffness, a damping or a capacitance would be negative.
    """

    def __init__(self, table: LawFit) -> None:
        form = table.form
        assert isinstance(form, Corners | Bends)
        self.most_line = _own_value(table)
        self.samples = table.samples
        self.x = spread_inputs(table)
        # A voltage in a circuit begins at zero, with the current of the part, unless a constant drop of diodes is free
        # beside it; elsewhere a constant goes with offsets.
        self.with_constant = not table.place.in_circuit or bool(drop_path(table.found.model.transducer, table.place))
        # A gain of a sensor is all but a change of parameters, which a table has taken in any share.
        line = table.law.bent or of_itself(table.place)
        self.basis = np.column_stack(
            [*pieces_of(form, self.x).T, *[np.ones(len(self.x))] * self.with_constant, *[self.x] * line]
        )
        inside, right = table.normal
        values, vectors = np.linalg.eigh(inside)
        values = np.maximum(values, 0.0)
        root = (vectors * np.sqrt(values)).T
        kinks = np.linalg.lstsq(inside, right, rcond=1e-13)[0]
        self.count = len(kinks)
        self.size = np.abs(self.basis).max(axis=0)
        self.size[self.size == 0.0] = 1.0
        self.inverse = np.linalg.pinv(self.basis / self.size, rcond=1e-10)
        self.whitened = root @ (self.inverse / self.size[:, None])[: self.count]
        self.found = root @ kinks

    def line(self, form: Form) -> float:
        """Slope of the straight line in a formula beside what the kinks of the table can stand for."""
        return float(self.lines(np.real(form.values(self.x))))

    def lines(self, values: np.ndarray) -> np.ndarray:
        """The same of functions by their values (..., n) at the inputs."""
        return values @ self.inverse[-1] / self.size[-1]

    def constant(self, form: Form) -> float:
        """Constant in a formula, likewise."""
        return float((self.inverse @ np.real(form.values(self.x)) / self.size)[self.count])


class CurveDistance(Distance):
    """Distance of a formula from the curve of another one, a constant and a straight line being free as beside a table.

    Values at the inputs stand for the kinks of a table.
    """

    def __init__(self, law: LawFit) -> None:
        self.most_line = _own_value(law)
        self.samples = law.samples
        self.x = spread_inputs(law, CURVE_SAMPLES)
        self.own = np.real(law.form.values(self.x))
        self.with_constant = True
        columns = [np.ones(len(self.x)), *[self.x] * (law.law.bent or of_itself(law.place))]
        self.beside = np.column_stack(columns)
        size = np.abs(self.beside).max(axis=0)
        self.inverse = np.linalg.pinv(self.beside / size) / size[:, None]
        left = np.eye(len(self.x)) - self.beside @ self.inverse
        self.whitened = left / (CURVE_UNIT * max(float(np.sqrt(np.mean((left @ self.own) ** 2))), np.finfo(float).tiny))
        self.found = self.whitened @ self.own

    def lines(self, values: np.ndarray) -> np.ndarray:
        """Slopes of the straight lines in functions beside that of the other formula."""
        return (values - self.own) @ self.inverse[-1]

    def constant(self, form: Form) -> float:
        """Constant in a formula, likewise."""
        return float((self.inverse @ (np.real(form.values(self.x)) - self.own))[0])


def _own_value(law: LawFit) -> float:
    """Value of the parameter of the model that is a straight line at the place, and free; infinite where none is.

    A coupling may have either sign.
    """
    path = (OWN.get(law.place.name, ""),)
    if not law.law.bent or path == ("coupling",) or path not in {p.path for p in law.found.model.parameters}:
        return np.inf
    return float(np.real(value_at(law.found.model.transducer, path)))


def of_itself(place: Place) -> bool:
    """True for the reading of a channel over its own value."""
    return isinstance(place, Reading) and place.of == place.channel
