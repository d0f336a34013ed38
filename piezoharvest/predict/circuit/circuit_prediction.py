"""Predicted response of a transducer behind a circuit with diodes or switches, with derivatives to its parameters.

The engine gives the events and, between them, the motion; derivatives are exact through the events
(`engine.transient`). Where a small change of a parameter lets the switch act at another extremum, the prediction jumps,
and no derivative tells: it is then that of the present sequence of events, and the fit, which takes a step only if the
cost falls, goes on from there.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import pairwise
from typing import Any, TypeAlias, TypeVar

import numpy as np

from piezoharvest.description.circuit import State
from piezoharvest.description.excitation import Excitation, Ramps
from piezoharvest.description.parameters import COMPLEX_STEP, ParameterError
from piezoharvest.description.shunts import LinearShunt, Resistor, Shunt
from piezoharvest.description.system import System
from piezoharvest.description.transducer import Transducer
from piezoharvest.engine.lowering.lower import lower
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.steady_search import EngineError
from piezoharvest.engine.transient.sampled_system import SampledSystem
from piezoharvest.engine.transient.variation import PlainRun, SampledRun, TimedSwitch
from piezoharvest.engine.work_limit import Budget
from piezoharvest.equations.rows import connected
from piezoharvest.equations.terms import Terms, state_names
from piezoharvest.predict.circuit.effect_groups import by_groups
from piezoharvest.predict.circuit.initial_state import initial_state
from piezoharvest.predict.circuit.measured_drive import MeasuredDrive
from piezoharvest.predict.circuit.readings import NEEDED, SampledCourse, read, read_more
from piezoharvest.predict.discrete_model import Setting
from piezoharvest.predict.drive import drive_of
from piezoharvest.predict.parameters import STEP, Parameter, put, stepped, value_at
from piezoharvest.predict.prediction import BLOCK, Block, Prediction, PredictionError

T = TypeVar("T")
Systems: TypeAlias = dict[tuple[Hashable, ...], SampledSystem]
CHANNELS = ("displacement", "velocity", "acceleration", "voltage", "current", "dc_voltage", "dc_current")
# Channels that are read from an output of another name: a current through a load, a force that an imposed motion takes.
OUTPUT_OF = {"dc_current": "dc_voltage", "force": "drive"}
# Times its size: largest magnitude of what a circuit begins with, but for a dc voltage, which is measured. With what
# electrodes may charge it to as size, ten times as much is a hundred times the energy; from there a fit that lacks
# something would run into chatter.
MOST_AT_FIRST = 10.0
MAX_CONDUCTANCE, MIN_CONDUCTANCE = 1e3, 1e-3  # times w C: a load that is all but a short, or none, for small noise

# Edges of a gate that are fitted: the time for a derivative grows with their number. Of more of them, each is known to
# a smaller share of what the record tells of the parameters, and samples near them count less (`event_noise`).
MAX_EDGES = 200
# Work limit of a record: of the least, and more for each sample. With a law of the transducer one takes up to 50,000
# (measured in two circuits); a charge that hardly rises with the voltage, which a fit may try, takes any amount.
LEAST_WORK, WORK_OF_SAMPLE = 500_000_000, 200_000


class CircuitPrediction:
    """A transducer and its circuit in a setting.

    Parameters
    ----------
    transducer : Transducer
    setting : Setting
        Its drive is a force, a base acceleration or a displacement.
    parameters : sequence of Parameter
        Variables of the derivatives.
    nuisance : (n,) array, optional
        Named in `nuisance_names`: deviations of the initial states from rest, in units of `Setting.sizes`, then those
        of the states of effects (SI units); the initial output of every stop as fraction of its threshold; the shifts
        of a gate's edges within their samples, as shares of what these may be. `nuisance_limits` are bounds of their
        magnitudes.
    relaxed : bool
        Stops begin at zero.
    felt : int, optional
        Number of effects that have an influence by themselves; those behind them are at or next to their null values,
        so that only derivatives with respect to their parameters count. Default: all.
    systems : dict, optional
        Systems that other predictions have made, to which these are added.
    begin_given : bool
        Derivatives are those with respect to the parameters alone.
    under_way : int
        Number of effects, the first ones, whose states, such as creep, may be out of equilibrium as the record begins.
    """

    channels = CHANNELS
    nonlinear = True
    bends = False  # between samples outputs may jump, where no spline goes through

    def __init__(
        self, transducer: Transducer, setting: Setting, parameters: Sequence[Parameter] = (),
        nuisance: np.ndarray | None = None, *, relaxed: bool = False, felt: int | None = None,
        systems: Systems | None = None, begin_given: bool = False, under_way: int = 0,
    ) -> None:  # fmt: skip
        self.transducer, self.setting, self.parameters, self.relaxed = transducer, setting, tuple(parameters), relaxed
        self.felt = len(transducer.effects) if felt is None else felt
        self.systems: Systems = {} if systems is None else systems
        self.begin_given, self._shared = begin_given, dict[Hashable, Any]()
        hysteresis = transducer.hysteresis
        stops = 0 if relaxed or hysteresis is None else len(hysteresis.thresholds)
        memories = tuple(f"history q{k}" for k in range(stops))
        edges = tuple(f"edge {k}" for k in range(loose_edges(setting)))
        self.under_way = under_way
        own = _own_states(put(transducer, ("effects",), transducer.effects[:under_way]), setting.drive)
        self.begun = tuple(effect for effect, _ in own)  # of each state of an effect that may be under way
        self.begun_states = tuple(state for _, state in own)
        free = tuple(f"start {name}" for name in (*setting.free, *(state.name for state in self.begun_states)))
        self.nuisance_names = (*free, *memories, *edges)
        self.nuisance = np.zeros(len(self.nuisance_names)) if nuisance is None else nuisance
        own_motion = state_names(transducer)
        of_circuit = [k for k, name in enumerate(setting.free) if name not in (*own_motion, "dc")]
        limits = np.full(len(free), np.inf)
        limits[of_circuit] = MOST_AT_FIRST
        self.nuisance_limits = np.concatenate([limits, np.ones(stops + len(edges))])

    @property
    def begun_from(self) -> int:
        """Place of the first state of an effect among the nuisance parameters."""
        return len(self.setting.free)

    @property
    def reach(self) -> np.ndarray:
        """Largest initial values, SI units, that the states of effects could have, in the order of `begun`."""
        return np.array([self.setting.reach * float(state.storage) ** -0.5 for state in self.begun_states])

    # Description with complex steps.

    @property
    def _device(self) -> Transducer:
        device = self.transducer
        return device.settled(self.setting.sample_time) if device.quasi_static else device

    @property
    def _shunt(self) -> Shunt:
        assert self.setting.shunt is not None  # it would be a record of a linear circuit
        return self.setting.shunt

    @cached_property
    def _drive(self) -> np.ndarray:
        lines = self.setting.motion.coefficients
        return np.append(lines[:, 0], lines[-1].sum())

    @cached_property
    def _stepped(self) -> Transducer:
        """Batch of transducers, each with a complex step of one parameter's variable."""
        found, count = self._device, len(self.parameters)
        for k, parameter in enumerate(self.parameters):
            inner = parameter.inner(value_at(self.transducer, parameter.path))
            step = np.zeros((count, 1), complex)
            step[k] = 1j * STEP
            found = put(found, parameter.path, _outer(parameter, inner + step))
        return found

    @cached_property
    def excitation(self) -> Excitation:
        """The drive of the record; of an imposed displacement the acceleration of its spline."""
        setting, step = self.setting, self.setting.sample_time
        if setting.drive == "displacement":
            bends = setting.motion.coefficients[:, 2:]
            values = np.append(2.0 * bends[:, 0], 2.0 * bends[-1, 0] + 6.0 * bends[-1, 1]) / step**2
            return MeasuredDrive(values=values, size=setting.size, sample_rate=1.0 / step, imposed=True)
        base = setting.drive == "base_acceleration"
        return MeasuredDrive(values=self._drive, size=setting.size, sample_rate=1.0 / step, base=base)

    @property
    def record_time(self) -> float | None:
        """Time (s) that passes in the record, for effects that change during it."""
        return self.setting.sample_time * (self.setting.count - 1)

    @cached_property
    def system(self) -> SampledSystem:
        """Matrices of all modes, with complex steps of the parameters, and tables that other records may have, too."""
        if self.setting.harmonics is not None:
            return self._lowered(self.excitation)
        setting = self.setting
        size = setting.size if any(effect.of_drive for effect in self.transducer.effects) else None
        key = self.transducer, self.parameters, self._shunt, setting.drive, setting.sample_time, size
        known = self.systems.get(key)
        if known is None:
            known = self._lowered(replace(self.excitation, values=np.ones(2)))
            if known.is_linear:
                self.systems[key] = known
        return known.under(self.excitation) if known.is_linear else self._lowered(self.excitation)

    def _lowered(self, excitation: Excitation) -> SampledSystem:
        try:
            with np.errstate(all="ignore"):  # the energy of an effect at its null value, which no motion depends on
                found = lower(System(self._stepped, self._shunt), excitation, self.record_time)
        except ParameterError as error:  # values that a fit tried have no equilibrium
            raise PredictionError(str(error)) from None
        if excitation.samples > 2:
            found = found._replace(budget=Budget(LEAST_WORK + WORK_OF_SAMPLE * int(excitation.samples)))
        return SampledSystem(found._replace(program=_magnified(found.program)), len(self.parameters))

    @cached_property
    def plain(self) -> CircuitPrediction:
        """The same without parameters."""
        if not self.parameters:
            return self
        return self.with_drive(self.setting)

    def with_drive(self, setting: Setting) -> CircuitPrediction:
        """The same without parameters under another drive."""
        kept: dict[str, Any] = {"relaxed": self.relaxed, "systems": self.systems, "under_way": self.under_way}
        return type(self)(self.transducer, setting, (), self.nuisance, **kept)

    # Prediction.

    def blocks(
        self, derivatives: bool = True, size: int = BLOCK, channels: Sequence[str] | None = None, parts: int = 1
    ) -> Iterator[Block]:
        """Predict the record, a block of samples at a time, as `Prediction.blocks`.

        Parameters
        ----------
        derivatives, size, channels
            As there.
        parts : int
            Has to be 1: between samples the outputs may jump.

        Raises
        ------
        PredictionError
            The circuit cannot be simulated with these values.
        """
        wanted = list(self.channels if channels is None else channels)
        if self.felt < len(self.transducer.effects):
            yield from by_groups(self, wanted, size, derivatives)
            return
        of = self if derivatives else self.plain
        outputs = [OUTPUT_OF.get(name, name) for name in wanted]
        sensing = {name: k for k, name in enumerate(wanted) if name in of._sensing}
        names = list(dict.fromkeys([*(NEEDED if sensing else ()), *outputs]))
        places = [names.index(name) for name in outputs]
        for begin, true, changes in of._run(names, size, derivatives):
            values, slopes = true[:, places], changes[:, places]
            of._through_load(wanted, values, slopes)
            if sensing:
                of._read(begin, (true[:, : len(NEEDED)], changes[:, : len(NEEDED)]), sensing, values, slopes)
            early = max(0, -begin)
            yield Block(begin + early, values[early:], slopes[early:], None)

    def _run(self, names: Sequence[str], size: int, derivatives: bool) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
        """Blocks (first sample, outputs, derivatives) of the engine's outputs; the first may be before the record."""
        system, last = self.system, self.setting.count - 1
        signal = system.lowered.signal
        assert isinstance(signal, Ramps)
        times = signal.times  # one for each sample
        try:
            edges = loose_edges(self.setting)
            begun = self.nuisance[: len(self.nuisance) - edges]
            shunt = connected(System(self._device, self._shunt)).shunt
            own = [state.name for state in self.begun_states]
            state, changes = initial_state(system, self.setting, shunt, begun, own)
            if self.begin_given:
                changes = changes[:, : system.count]
            elif edges:
                changes = np.pad(changes, ((0, 0), (0, edges)))
            switch = self._timed(system.plain.program, changes.shape[1])
            if derivatives:
                run = SampledRun(system, times, state, changes, names, switch)
            else:
                run = PlainRun(system, times, state, names, switch)
            for begin, end in pairwise([0, *range(size - 1, last, size), last]):
                first = 0 if begin == 0 else 1  # the sample before a block is not written again
                if isinstance(run, SampledRun):
                    values, slopes = run.through(begin, end)
                else:
                    values = run.through(begin, end)
                    slopes = np.zeros((*values.shape, 0))
                yield begin + first, values[first:], slopes[first:]
        except EngineError as error:
            raise PredictionError(str(error)) from None

    def _timed(self, program: pg.Program, lanes: int) -> TimedSwitch | None:
        """The switch of the circuit where a recorded gate times it."""
        gate = self.setting.gate
        if gate is None:
            return None
        causes, changes, loose = gate.times.copy(), np.zeros((len(gate.times), lanes)), loose_edges(self.setting)
        if loose:
            causes += gate.error * self.nuisance[-loose:]
        if loose and not self.begin_given:
            changes[:, -loose:] = gate.error * np.eye(loose)
        return TimedSwitch(causes, changes, program)

    @cached_property
    def _sensing(self) -> set[str]:
        """Channels whose sensors may read anything but the true value; a drive is measured as it is."""
        return read_more(self._device, self.setting.drive) - {self.setting.drive}

    def _read(
        self, begin: int, needed: tuple[np.ndarray, np.ndarray], channels: Mapping[str, int], values: np.ndarray,
        slopes: np.ndarray,
    ) -> None:  # fmt: skip
        """Let sensors read from some sample on."""
        lanes, device, at = slopes.shape[2], self._device, begin + np.arange(len(values))
        tangents = [stepped(device, p, p.inner(value_at(self.transducer, p.path))) for p in self.parameters[:lanes]]
        devices = [device, *tangents, *[device] * (lanes - len(tangents))]
        setting = self.setting
        time = at / (setting.count - 1) if self.record_time is not None else np.zeros(len(at))
        samples = SampledCourse(setting.drive, self._drive_at(at), time, setting.sample_time, setting.size)
        read(devices, samples, needed, channels, values, slopes)

    def _drive_at(self, samples: np.ndarray) -> np.ndarray:
        """The drive at samples of the record."""
        return self._drive[samples]

    def _through_load(self, wanted: Sequence[str], values: np.ndarray, slopes: np.ndarray) -> None:
        """Overwrite dc voltages by dc currents where these are wanted."""
        if "dc_current" not in wanted:
            return
        circuit: Any = connected(System(self._stepped, self._shunt)).shunt
        resistance = np.ravel(circuit.load_resistance)
        value, change = float(np.real(resistance[0])), np.imag(resistance) / STEP
        for k in (k for k, name in enumerate(wanted) if name == "dc_current"):
            values[:, k] /= value
            slopes[:, k] /= value
            count = min(len(self.parameters), slopes.shape[2])
            slopes[:, k, :count] -= values[:, k, None] * np.broadcast_to(change, count) / value

    # Small noise of the drive.

    @cached_property
    def linear(self) -> Prediction:
        """Prediction for small noise of the drive: with a linear circuit itself, if equations of records can have it.

        Else it is that in the mean, with the resistor that takes the same power. Its conductance is that of the
        describing function, the mean of v i over that of v^2.
        """
        if self.parameters:
            return self.plain.linear
        setting, device = self.setting, self._device
        if isinstance(setting.shunt, LinearShunt):
            try:
                return Prediction(device, replace(setting, motion=drive_of(self._drive), free=(), sizes=()))
            except ParameterError:
                pass  # a capacitor across the leads beside hysteresis
        power = square = 0.0
        for block in self.blocks(derivatives=False, channels=("voltage", "current")):
            v, i = block.values.T
            power, square = power + float(v @ i), square + float(v @ v)
        unit = np.sqrt(device.stiffness / device.mass) * device.capacitance
        conductance = np.clip(power / square if square > 0 else 0.0, MIN_CONDUCTANCE * unit, MAX_CONDUCTANCE * unit)
        shunt = Resistor(resistance=float(1.0 / conductance))
        return Prediction(device, replace(setting, shunt=shunt, motion=drive_of(self._drive), free=(), sizes=()))

    def shared(self, key: Hashable, make: Callable[[], T]) -> T:
        """What is made once for a prediction: the resistor that stands for its circuit depends on the record."""
        if self.parameters:
            return self.plain.shared(key, make)
        if key not in self._shared:
            self._shared[key] = make()
        return self._shared[key]

    def settle(self) -> None:
        """Propagate through the record unless already done, so that `linear` is known."""
        self.linear.settle()


def loose_edges(setting: Setting) -> int:
    """Number of edges of a gate whose places within their samples are nuisance parameters."""
    gate = setting.gate
    return 0 if gate is None or gate.error == 0.0 or len(gate.times) > MAX_EDGES else len(gate.times)


def _own_states(transducer: Transducer, drive: str) -> list[tuple[int, State]]:
    """States of effects, each with the effect's index.

    An effect that a fit has brought to its null value keeps them: how many numbers a record has must not change.
    """
    drive = "force" if drive == "displacement" else drive  # states do not depend on it
    counts, found = [0], list[State]()
    with np.errstate(all="ignore"):  # the energy of an effect at its null value
        for n in range(1, len(transducer.effects) + 1):
            found = Terms(put(transducer, ("effects",), transducer.effects[:n]), drive, absent=True).states
            counts.append(len(found))
    owners = [n for n, count in enumerate(np.diff(counts)) for _ in range(count)]
    return list(zip(owners, found, strict=True))


def _outer(parameter: Parameter, inner: np.ndarray) -> np.ndarray:
    """Values (count, 1) from complex steps of the variable; an absent component has the infinite value."""
    if parameter.scaling != "reciprocal":
        return parameter.outer(inner)
    return np.divide(1.0, inner, out=np.full(inner.shape, np.inf, complex), where=inner != 0)


def _magnified(program: pg.Program) -> pg.Program:
    """Program with the complex steps of the engine's sensitivities, from smaller ones."""

    def grown(array: Any) -> Any:
        if not np.iscomplexobj(array):
            return array
        found: Any = np.array(array)
        found.imag *= COMPLEX_STEP / STEP  # a product with 1j would make a NaN of what is infinite
        return found

    return program._replace(**{name: grown(getattr(program, name)) for name in pg.NUMBERS})
