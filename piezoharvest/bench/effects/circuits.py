"""Effects in the circuit behind the electrodes: other parts than its label says, and meters on it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

from piezoharvest.bench.effects.base import BenchEffect
from piezoharvest.description.parameters import ParameterError, described, quantity
from piezoharvest.description.shunts import Shunt


def relabelled(shunt: Shunt, key: str, value: Any) -> Shunt:
    """The circuit with another value of a key, or as it is if it has no such key."""
    return replace(shunt, **{key: value(getattr(shunt, key))}) if hasattr(shunt, key) else shunt


@dataclass(frozen=True, kw_only=True)
class SwitchDelay(BenchEffect):
    """Every action of the switch is later by `time_lag`."""

    name: ClassVar[str] = "switch_delay"

    time_lag: float = quantity("s", "delay in addition to the nominal one", at_least=0, null=0.0)

    def connect(self, shunt):
        """The circuit with `time_lag` added to its own."""
        return relabelled(shunt, "time_lag", lambda label: label + self.time_lag)


@dataclass(frozen=True, kw_only=True)
class InversionLoss(BenchEffect):
    """The switched loop has the quality `quality`, whatever its label says."""

    name: ClassVar[str] = "inversion_loss"

    quality: float = quantity("", "quality of the switched loop", above=0.5)

    def connect(self, shunt):
        """The circuit with the loop's quality replaced."""
        return relabelled(shunt, "quality", lambda label: self.quality)


@dataclass(frozen=True, kw_only=True)
class DiodeDropError(BenchEffect):
    """Every diode drops `diode_drop`, whatever its label says."""

    name: ClassVar[str] = "diode_drop_error"

    diode_drop: float = quantity("V", "forward drop of one diode", at_least=0)

    def connect(self, shunt):
        """The circuit with the diodes' drop replaced."""
        return relabelled(shunt, "diode_drop", lambda label: self.diode_drop)


@dataclass(frozen=True, kw_only=True)
class OnTimeOffset(BenchEffect):
    """The switch is closed for (1 + label's error + `on_time_error`) half periods; a short at once has none."""

    name: ClassVar[str] = "on_time_offset"

    on_time_error: float = quantity("", "relative error in addition to the nominal one", above=-1, null=0.0)

    def connect(self, shunt):
        """The circuit with the relative error added to that of its on-time."""
        return relabelled(shunt, "on_time_error", lambda label: label + self.on_time_error)


@dataclass(frozen=True, kw_only=True)
class MissedSwitching(BenchEffect):
    """Extrema at which the electrode voltage is below `threshold` are not switched."""

    name: ClassVar[str] = "missed_switching"

    threshold: float = quantity("V", "electrode voltage below which the switch does not act", at_least=0, null=0.0)

    def connect(self, shunt):
        """The circuit with a detector whose threshold is at least this one."""
        return relabelled(shunt, "detector_threshold", lambda label: max(label, self.threshold))


@dataclass(frozen=True, kw_only=True)
class ReverseLeakage(BenchEffect):
    """A conductance beside each diode of a bridge."""

    name: ClassVar[str] = "reverse_leakage"

    conductance: float = quantity("S", "reverse conductance of one diode", at_least=0, null=0.0)

    def connect(self, shunt):
        """The circuit with the conductance added to that of its diodes."""
        return relabelled(shunt, "diode_leakage", lambda label: label + self.conductance)


@dataclass(frozen=True, kw_only=True)
class VoltageReversion(BenchEffect):
    """A capacitance that a resistance keeps from following a sudden change of v_t, of which it takes `share` later.

    C_r in series with R, beside C: the two capacitances share a charge in the ratio C_r/(C + C_r) = share, with the
    time constant of R and both in series.
    """

    name: ClassVar[str] = "voltage_reversion"

    share: float = quantity("", "fraction of a sudden voltage change that is lost", at_least=0, below=1, null=0.0)
    time_constant: float = quantity("s", "time constant with which it is lost, electrodes open", above=0)

    def act(self, model, duration):
        """Add the charge behind the resistance as a state, and draw its current."""
        if not self.share:
            return
        clamped = model.transducer.capacitance
        slow = self.share * clamped / (1.0 - self.share)
        resistance = self.time_constant * (1.0 / clamped + 1.0 / slow)

        def rate(m):
            return (m.v_t - m.y[row] / slow) / resistance

        row = model.add_state(1.0 / slow, rate, lambda m: 0.0 * m.x[0])
        model.slow_charges.append(row)


@dataclass(frozen=True, kw_only=True)
class ProbeLoading(BenchEffect):
    """A meter's resistance and capacitance across the leads, or beside the load behind a bridge."""

    name: ClassVar[str] = "probe_loading"

    resistance: float = quantity("ohm", "input resistance of the meter", above=0, null=float("inf"))
    capacitance: float = quantity("F", "input capacitance of the meter and its cable", default=0.0, at_least=0)
    place: Literal["leads", "dc"] = described("across the electrodes, or across the dc side", default="leads")

    def act(self, model, duration):
        """Draw the meter's current from the leads, and put its capacitance beside C."""
        if self.place == "dc":
            return
        model.drawn.append(lambda m: m.v / self.resistance)
        if self.capacitance and model.dielectric != model.linear_dielectric:
            raise ParameterError(
                "capacitance", "voltage_dependent_capacitance is given too, but only one of the two may be"
            )
        model.beside += self.capacitance

    def connect(self, shunt):
        """The circuit with the meter beside its dc load."""
        if self.place == "leads" or getattr(shunt, "smoothing_capacitance", None) is None:
            return shunt
        shunt = relabelled(shunt, "smoothing_capacitance", lambda label: label + self.capacitance)
        return relabelled(shunt, "dc_leakage", lambda label: label + 1.0 / self.resistance)
