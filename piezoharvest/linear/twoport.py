"""Exact two-port of a transducer at given frequencies: impedance, admittance, hybrid and chain matrices."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.transducer import Transducer
from piezoharvest.linear.assembly import OperatingPoint, angular, connect, hysteresis_slope
from piezoharvest.notebook import Row, Shown, axes_for, extent, frame, over


@dataclass(frozen=True, eq=False, repr=False)
class TwoPort(Shown):
    """Linear two-port at a set of frequencies.

    The ports are (F, u), force and velocity, and (v, i_p), voltage and current; u and i_p flow INTO the two-port, so
    that F u and v i_p are the powers supplied to it. Only `abcd` has the LOAD current i = -i_p, out of the second port,
    so that two-ports in a chain multiply. The second port of a cascade is that of the last two-port.

    Attributes
    ----------
    frequencies : (f,) array
        Hz.
    z : (f, 2, 2) complex array
        Impedance matrix: (F, v) = z (u, i_p); [[N s/m, N/A], [V s/m, ohm]].
    """

    frequencies: np.ndarray
    z: np.ndarray

    @property
    def heading(self) -> str:
        """How many frequencies it has, and between which."""
        return over(self.frequencies)

    @property
    def rows(self) -> list[Row]:
        """The ranges of frequency and of the magnitudes of z."""
        return [extent("frequency", "Hz", self.frequencies), *(extent(*each) for each in self._named())]

    def to_frame(self) -> Any:
        """The complex elements of z over the frequency (Hz) as a `pandas.DataFrame`; raises `ImportError`."""
        columns = {name: values for name, _, values in self._named()}
        return frame({"frequency": self.frequencies, **columns}).set_index("frequency")

    def plot(self, ax: Any = None) -> Any:
        """Draw the impedances at the leads over the frequency into axes of matplotlib: free, and with it held.

        In a new figure those at the mechanical port stand below them, with open and shorted leads. All are magnitudes.

        Returns
        -------
        Axes or list of Axes
            The axes given, or those of the new figure.
        """
        axes = axes_for(ax, 2, sharex=True)
        leads = {"free": self.impedance("free"), "clamped": self.impedance("blocked")}
        ends = {"open": self.mechanical_impedance(), "shorted": self.mechanical_impedance(0.0)}
        for each, curves, label in zip(axes, (leads, ends), ("v/i in ohm", "F/u in N s/m"), strict=False):
            for name, values in curves.items():
                each.plot(self.frequencies, np.abs(values), label=name)
            each.set(ylabel=label, yscale="log")
            each.legend()
        axes[-1].set(xlabel="frequency in Hz")
        return ax if ax is not None else axes

    def _named(self) -> list[tuple[str, str, np.ndarray]]:
        """Name, unit and values of each element of z."""
        units = ("N s/m", "N/A", "V s/m", "ohm")
        return list(zip(("z11", "z12", "z21", "z22"), units, self._elements(), strict=True))

    @classmethod
    def of(
        cls,
        transducer: Transducer,
        frequencies: Any,
        *,
        amplitude: float | None = None,
        operating_point: OperatingPoint = "stick",
    ) -> TwoPort:
        """Two-port of a transducer with its modes and linear effects.

        Parameters
        ----------
        transducer : Transducer
        frequencies : (f,) array
            Hz.
        amplitude : float, optional
            Charge amplitude in C of the describing function that represents the hysteresis.
        operating_point : "stick", "slip" or sequence of bool
            Hysteresis by its slope, without `amplitude`.

        Raises
        ------
        ParameterError
            A frequency is not above zero, or no force moves the transducer.
        """
        frequencies = np.atleast_1d(np.asarray(frequencies, float))
        slope = hysteresis_slope(transducer, operating_point, amplitude)
        model = connect(
            transducer, lambda ports, z, dz, w: [ports[0].i - w["current"]],
            slope=slope, operating_point=operating_point, electrical=("current",),
        )  # fmt: skip
        transfer = model.phasors(angular(frequencies))
        responses = np.stack((transfer(model.rows["velocity"]), transfer(model.rows["voltage"])), axis=-2)
        if np.any(responses[:, 0, 0] == 0):
            raise ParameterError("force_participation", "no mode is driven by the force, at least one must be")
        return cls.from_responses(frequencies, responses)

    @classmethod
    def from_responses(cls, frequencies: np.ndarray, responses: np.ndarray) -> TwoPort:
        """Two-port from its responses (f, 2, 2), defined as `responses`."""
        u, v = responses[:, 0], responses[:, 1]
        # u = u_F F - u_i i_p and v = v_F F - v_i i_p, solved for F and v; the input was the load current, -i_p.
        force = np.stack((1 / u[:, 0], u[:, 1] / u[:, 0]), axis=-1)
        voltage = v[:, :1] * force - np.stack((0 * v[:, 1], v[:, 1]), axis=-1)
        return cls(np.asarray(frequencies, float), np.stack((force, voltage), axis=-2))

    @classmethod
    def from_abcd(cls, frequencies: np.ndarray, abcd: np.ndarray) -> TwoPort:
        """Two-port from its chain matrix (f, 2, 2), defined as `abcd`."""
        a, b, c, d = (abcd[..., i, j] for i in (0, 1) for j in (0, 1))
        return cls(np.asarray(frequencies, float), _matrix(a / c, (a * d - b * c) / c, 1 / c, d / c))

    @property
    def y(self) -> np.ndarray:
        """Admittance matrix: (u, i_p) = y (F, v); the inverse of z."""
        z11, z12, z21, z22 = self._elements()
        determinant = z11 * z22 - z12 * z21
        return _matrix(z22, -z12, -z21, z11) / determinant[..., None, None]

    @property
    def h(self) -> np.ndarray:
        """Hybrid matrix: (F, i_p) = h (u, v), the form of the model's equations; h11 is the short-circuit impedance."""
        z11, z12, z21, z22 = self._elements()
        return _matrix(z11 - z12 * z21 / z22, z12 / z22, -z21 / z22, 1 / z22)

    @property
    def abcd(self) -> np.ndarray:
        """Chain matrix: (F, u) = abcd (v, i) with the load current i = -i_p."""
        z11, z12, z21, z22 = self._elements()
        return _matrix(z11, z11 * z22 - z12 * z21, np.ones_like(z11), z22) / z21[..., None, None]

    @property
    def responses(self) -> np.ndarray:
        """What force and load current move: (u, v) = responses (F, i), as `linearize` gives it."""
        z11, z12, z21, z22 = self._elements()
        return _matrix(1 / z11, z12 / z11, z21 / z11, z12 * z21 / z11 - z22)

    def _elements(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        return self.z[..., 0, 0], self.z[..., 0, 1], self.z[..., 1, 0], self.z[..., 1, 1]

    def impedance(self, mechanical: Literal["free", "blocked"] = "free") -> np.ndarray:
        """Impedance v/i_p at the leads, ohm, (f,) array, with the mechanical port free or clamped."""
        z11, z12, z21, z22 = self._elements()
        if mechanical not in ("free", "blocked"):
            raise ParameterError("mechanical", f'found "{mechanical}", must be "free" or "blocked"')
        return z22 if mechanical == "blocked" else z22 - z12 * z21 / z11

    def mechanical_impedance(self, load: Any = np.inf) -> np.ndarray:
        """Impedance F/u, N s/m, (f,) array, with a load impedance (ohm; scalar or (f,) array) at the leads."""
        z11, z12, z21, z22 = self._elements()
        return z11 - z12 * z21 / (z22 + load)

    def efficiency(self, load: Any) -> np.ndarray:
        """Power into a load impedance over mechanical input power, P_out/P_in of equation 13, (f,) array.

        Parameters
        ----------
        load : complex or (f,) array
            Load impedance, ohm.
        """
        _, _, z21, z22 = self._elements()
        current = z21 / (z22 + load)
        return np.real(load) * np.abs(current) ** 2 / np.real(self.mechanical_impedance(load))

    @property
    def reciprocity_error(self) -> float:
        """Largest |z12 - z21| relative to the larger of the two; 0 when reciprocal."""
        _, z12, z21, _ = self._elements()
        size = np.maximum(np.abs(z12), np.abs(z21))
        return float(np.max(np.abs(z12 - z21) / np.where(size > 0, size, 1.0), initial=0.0))

    @property
    def passivity_margin(self) -> float:
        """Least eigenvalue, over all frequencies, of the Hermitian part of z with both ports scaled to |z_ii| = 1.

        Zero for a lossless two-port, negative for one that can deliver net power.
        """
        scale = 1 / np.sqrt(np.abs(np.stack((self.z[..., 0, 0], self.z[..., 1, 1]), axis=-1)))
        scaled = self.z * scale[..., :, None] * scale[..., None, :]
        return float(np.min(np.linalg.eigvalsh((scaled + scaled.conj().swapaxes(-1, -2)) / 2), initial=np.inf))

    def is_reciprocal(self, tolerance: float = 1e-9) -> bool:
        """True if z is symmetric: `reciprocity_error` within the tolerance."""
        return self.reciprocity_error <= tolerance

    def is_passive(self, tolerance: float = 1e-9) -> bool:
        """True if it absorbs net power in every operation at these frequencies: `passivity_margin` >= -tolerance."""
        return self.passivity_margin >= -tolerance

    def __matmul__(self, other: TwoPort | np.ndarray) -> TwoPort:
        """Chain: the leads of this two-port feed the first port of `other`, a two-port or its chain matrix."""
        if isinstance(other, TwoPort):
            if not np.array_equal(other.frequencies, self.frequencies):
                raise ParameterError("frequencies", "the two-ports have different frequencies, but must have the same")
            other = other.abcd
        return TwoPort.from_abcd(self.frequencies, self.abcd @ other)


def series_element(impedance: Any) -> np.ndarray:
    """Chain matrix (..., 2, 2) of an impedance (ohm) in series with the leads."""
    impedance = np.asarray(impedance, complex)
    one = np.ones_like(impedance)
    return _matrix(one, impedance, 0 * one, one)


def parallel_element(admittance: Any) -> np.ndarray:
    """Chain matrix (..., 2, 2) of an admittance (S) across the leads."""
    admittance = np.asarray(admittance, complex)
    one = np.ones_like(admittance)
    return _matrix(one, 0 * one, admittance, one)


def conversion_efficiency(
    transducer: Transducer, load: Any, frequencies: Any, *, amplitude: float | None = None
) -> np.ndarray:
    """Conversion efficiency P_out/P_in (equation 13) of a transducer with an impedance load.

    Parameters
    ----------
    transducer : Transducer
    load : complex or (f,) array
        Load impedance, ohm.
    frequencies : (f,) array or float
        Hz.
    amplitude : float, optional
        Charge amplitude in C at which the hysteresis enters by its describing function.

    Returns
    -------
    (f,) array
        From 0 to 1 for a passive load; the rest is lost in damping, hysteresis and effects.
    """
    return TwoPort.of(transducer, frequencies, amplitude=amplitude).efficiency(load)


def _matrix(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Matrices [[a, b], [c, d]] over the leading axes."""
    return np.stack((np.stack((a, b), axis=-1), np.stack((c, d), axis=-1)), axis=-2)
