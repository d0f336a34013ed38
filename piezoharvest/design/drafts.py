"""Draft candidates before tuning: the kinds that are suitable, their free fields, and assumed values of the others."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, field
from functools import cached_property
from types import SimpleNamespace
from typing import Any

import numpy as np

from piezoharvest.description.circuit import Port
from piezoharvest.description.diode import straight_diode
from piezoharvest.description.parameters import Component, ParameterError
from piezoharvest.description.shunts import LinearShunt, Shunt, registered
from piezoharvest.description.shunts.base import Leads
from piezoharvest.description.shunts.bridge import Bridge
from piezoharvest.description.shunts.curves.curved import takes_diode_curve
from piezoharvest.description.shunts.linear.open import Open
from piezoharvest.description.shunts.linear.short import Short
from piezoharvest.description.shunts.switching import SwitchedCoil, SynchronisedShunt
from piezoharvest.description.system import System
from piezoharvest.description.transducer import Transducer
from piezoharvest.design.operation import Operation
from piezoharvest.design.places import lists_of, owner, split, unit_at, value_at, with_values
from piezoharvest.engine import simulate
from piezoharvest.linear import frequency_response
from piezoharvest.study import SYNTHESISED, DesignOptions

QUALITY = 6.0  # inverts to exp(-pi/(2 Q)) = 0.77 of the voltage: between the 0.6 of a small coil and 0.9 of a good one
FLIP_SHARE = 1 / 50  # of the period: short beside it, and still slow enough for a coil
# R C_s in periods. In the steady state, which takes as long to find with any, the dc voltage then moves by 0.5 % in a
# half period and the best load by 0.2 %; where charging up counts, by 2.5 % and 1 %.
STEADY_PERIODS, TRANSIENT_PERIODS = 100.0, 20.0
NEGATIVE_SHARE = 0.5  # of the capacitance: doubles K^2, with as much again to the limit of stability
_MOST_BRANCHES = 3  # of assumed shunts with a branch for each mode: more parts than that take long to tune
_TUNED_UNITS = ("ohm", "H", "F")
# Parts that all candidates share, as a study's first table that has them says: of a bridge, of a switched coil, and
# what beside them only counts where a table gives it.
DIODE = ("diode_drop", "diode_resistance", "diode_leakage", "diode_saturation")
COIL = ("switch_resistance", "core_resistance", "self_resonance")
BESIDE = ("smoothing_resistance", "dc_leakage", "gate_energy", "control_power")
CURVES = ("diode_curve", "switch_curve", "loop_sections")  # tables, of diodes, of a switch and of its loop
LOAD_CURVE = "load_curve"  # what else is at the dc side, beside a load resistance
ANGLES = ("phase_lag", "on_time_error")  # fields that may be negative: they are not tuned as logarithms


@dataclass(frozen=True, eq=False)
class Draft:
    """A shunt with initial values, and the fields that tuning may change.

    Attributes
    ----------
    shunt : Shunt
    free : tuple of str
        Names of the fields to tune.
    assumed : tuple of str
        Assumptions where no template gives a value, in words.
    smoothing : float or None
        Time constant of the smoothing capacitance with the load, s, where that capacitance is assumed; else None.
    late : tuple of str
        Names of fields that are tuned together with the free ones after these (`tuning.late`).
    formula : str
        Origin of initial values that are near an optimum: tuning starts from them alone. Empty: from closed forms.
    """

    shunt: Shunt
    free: tuple[str, ...] = ()
    assumed: tuple[str, ...] = ()
    smoothing: float | None = None
    late: tuple[str, ...] = ()
    formula: str = ""

    @property
    def kind(self) -> str:
        """Kind of the shunt."""
        return self.shunt.kind

    def branches(self) -> Iterator[tuple[str, Shunt]]:
        """The circuit and its others at further electrodes, each with the prefix of its fields' names."""
        yield "", self.shunt
        for n, other in enumerate(self.shunt.others):
            yield f"others.{n}.", other

    def first(self) -> dict[str, float]:
        """Present values of the free fields."""
        return self.values_of(self.shunt)

    def values_of(self, shunt: Shunt) -> dict[str, float]:
        """Values of the free fields in a shunt of this kind."""
        return {name: value_at(shunt, name) for name in self.free}

    @property
    def tied(self) -> dict[str, str]:
        """Fields that fall in proportion as a free field, the key, rises: the assumed smoothing capacitance."""
        return {} if self.smoothing is None else {"load_resistance": "smoothing_capacitance"}

    def with_values(self, values: Mapping[str, Any]) -> Shunt:
        """The shunt with other values of its free fields; an assumed smoothing capacitance is scaled with the load."""
        values = dict(values)
        if self.smoothing is not None and "load_resistance" in values:
            values["smoothing_capacitance"] = self.smoothing / values["load_resistance"]
        return with_values(self.shunt, values)


@dataclass
class Drafting:
    """Makes the drafts of a design.

    Attributes
    ----------
    transducer : Transducer
    templates : sequence of Shunt
        The shunts of the study: their fields that are not tuned are kept.
    options : DesignOptions
    operation : Operation
    left_out : list of str
        Reasons why kinds that were named, or are suitable, are not among the drafts.
    unlike : list of str
        Remarks on properties of devices that differ between the drafts.
    """

    transducer: Transducer
    templates: Sequence[Shunt]
    options: DesignOptions
    operation: Operation
    left_out: list[str] = field(default_factory=list)
    unlike: list[str] = field(default_factory=list)

    @cached_property
    def frequency(self) -> float:
        """Frequency at which impedances are compared and periods are counted, Hz."""
        return self.operation.centre(self.seen)

    @cached_property
    def beside(self) -> dict[str, Any]:
        """Electrodes and others of kinds without a template: those of the first template."""
        first = self.templates[0] if self.templates else Open()
        return {"electrode": first.electrode, "others": first.others}

    @cached_property
    def seen(self) -> Transducer:
        """The transducer as kinds without a template see it: their electrodes are its own."""
        return self.transducer.swapped(self.beside["electrode"])

    @cached_property
    def leads(self) -> Leads:
        """The leads in operation."""
        excitation = self.operation.at(self.frequency) if self.operation.apart else self.operation.excitation
        opened = simulate(System(self.seen, Open()), excitation, attenuation=False).voltage_amplitude
        blocking = opened * _blocking_share(self.seen, self.frequency, self.operation.base)
        return Leads(self.seen.capacitance, self.frequency, opened, blocking)

    def drafts(self) -> list[Draft]:
        """One draft for each kind, or for each template of it.

        Raises
        ------
        ParameterError
            No kind is left.
        """
        named = self.options.candidates
        found: list[Draft] = []
        for kind in registered() if named is None else [k for k in dict.fromkeys(named) if k != SYNTHESISED]:
            cls = registered()[kind]
            own = [shunt for shunt in self.templates if shunt.kind == kind]
            drafts = [self._from_template(shunt) for shunt in own] or self._assume(cls, named is not None)
            found += [draft for draft in drafts if named is not None or self._fits(draft.shunt, bool(own))]
        if not found and SYNTHESISED not in (named or ()):
            reasons = "; ".join(self.left_out) or "no kind of shunt fits the objective"
            raise ParameterError("design.candidates", f"no candidate can be designed ({reasons})")
        found = _distinct(found)
        self.unlike = self._unlike(found)
        return found

    def _fits(self, shunt: Shunt, templated: bool) -> bool:
        """True if a kind that was not named is suitable."""
        if isinstance(shunt, Open | Short):
            return False
        if not templated and any(state.storage < 0 for state in shunt.states(self.seen.capacitance)):
            return False  # active parts only where they are asked for
        if self.options.objective == "trade_off":
            return True
        gives = any_harvests(shunt, self.transducer, 1 / self.frequency)
        return gives if self.options.objective == "harvest" else isinstance(shunt, LinearShunt) or not gives

    def _from_template(self, shunt: Shunt) -> Draft:
        return Draft(shunt, self._free(shunt), late=self._late(shunt))

    def _free(self, shunt: Shunt) -> tuple[str, ...]:
        """Fields to tune: of a circuit, and of its others where it is linear as they are."""
        return (*self._own(shunt), *(self._of_others(shunt) if isinstance(shunt, LinearShunt) else ()))

    def _of_others(self, shunt: Shunt) -> list[str]:
        """Fields to tune of the others, under their names in the shunt."""
        return [f"others.{n}.{name}" for n, other in enumerate(shunt.others) for name in self._own(other)]

    def _own(self, shunt: Shunt) -> tuple[str, ...]:
        """Fields to tune: parts of linear circuits except active ones, the load of a bridge, the lag of a switch."""
        names: list[str] = []
        if isinstance(shunt, Bridge) and shunt.tuned_side:
            names.append(shunt.tuned_side)
        if isinstance(shunt, SynchronisedShunt) and self._lag_is_free(shunt):
            names.append("phase_lag")
        if isinstance(shunt, LinearShunt):
            capacitance = self.transducer.all_electrodes[shunt.electrode].capacitance
            active = [-state.storage for state in shunt.states(capacitance) if state.storage < 0]
            names += [name for name in _entries(shunt) if value_at(shunt, name) not in active]
        names += shunt.tuned
        held = self.options.hold
        return tuple(name for name in names if name.partition(".")[0] not in held)

    def _late(self, shunt: Shunt) -> tuple[str, ...]:
        """Fields to tune after these: what the study names besides, parts of others, the time lag but under a sine."""
        names = [name for name in self.options.tune or () if getattr(shunt, name, None) is not None]
        names += [] if isinstance(shunt, LinearShunt) else self._of_others(shunt)
        if not self.operation.apart and isinstance(shunt, SynchronisedShunt) and self._lag_is_wanted(shunt):
            names.append("time_lag")
        return tuple(name for name in names if name not in self.options.hold)

    def _lag_is_free(self, shunt: SynchronisedShunt) -> bool:
        """True if a switch's lag is tuned as an angle: of a sine, there is none under other excitations."""
        return self._lag_is_wanted(shunt) and self.operation.apart

    def _lag_is_wanted(self, shunt: SynchronisedShunt) -> bool:
        """True if a switch's lag is to be tuned: by default where power counts."""
        objective = self.options.objective
        pays = objective == "harvest" or (
            objective == "trade_off" and any_harvests(shunt, self.transducer, 1 / self.frequency)
        )
        wanted = self.options.phase_lag or ("free" if pays else "fixed")
        return wanted == "free"

    def _assume(self, cls: type[Shunt], wanted: bool) -> list[Draft]:
        """Draft of a kind without a template, with typical values; empty where a value cannot be assumed."""
        modes = self.operation.modes(self.seen)[:_MOST_BRANCHES]
        branches = lists_of(cls) if issubclass(cls, LinearShunt) else ()
        if branches and len(modes) < 2:
            if wanted:
                self.left_out.append(f"{cls.kind}, as fewer than two modes are in the band")
            return []
        values, notes = self._typical(cls)
        for name in branches:  # the tuning begins elsewhere: only the number of branches counts
            values[name] = (values[name],) * (len(modes) - (name == "capacitances" and cls.kind == "parallel_branches"))
        try:
            if wanted and _needed(cls, values):
                own, note = cls.assumed_if_named(self.leads, values)
                values, notes = values | own, (*notes, *([note] if note else []))
            needed = _needed(cls, values)
            if needed:
                if not wanted and cls.assumed_if_named.__func__ is not Shunt.assumed_if_named.__func__:
                    self.left_out.append(f"{cls.kind}, which is tried where candidates name it")
                elif wanted or self._may_fit(cls):
                    self.left_out.append(f"{cls.kind}, whose {' and '.join(needed)} only a [[shunts]] table can give")
                return []
            shunt = cls(**values, **self.beside)
        except ParameterError as error:  # parts that the study's tables give do not go together in this kind
            self.left_out.append(f"{cls.kind}: {error}")
            return []
        smoothing = self._smoothing if isinstance(shunt, Bridge) and not shunt.whole_side else None
        return [Draft(shunt, self._free(shunt), notes, smoothing, self._late(shunt))]

    @property
    def _smoothing(self) -> float:
        """Time constant in s of an assumed smoothing capacitance with the load."""
        return (STEADY_PERIODS if self.operation.periodic else TRANSIENT_PERIODS) / self.frequency

    def _may_fit(self, cls: type[Shunt]) -> bool:
        """True if a kind that cannot be built could be of use: one that only switches does not harvest."""
        if self.options.objective != "harvest" or issubclass(cls, Bridge) or not issubclass(cls, SynchronisedShunt):
            return True
        return cls.harvested_share is not SynchronisedShunt.harvested_share

    def _typical(self, cls: type[Shunt]) -> tuple[dict[str, Any], tuple[str, ...]]:
        """Typical values of a kind's fields, and remarks on them."""
        capacitance, omega = self.seen.capacitance, 2 * np.pi * self.frequency
        if issubclass(cls, LinearShunt):
            scale = {"ohm": 1 / (omega * capacitance), "H": 1 / (omega**2 * capacitance), "F": capacitance}
            values = {name: scale[unit] for name, unit in _parts(cls).items()}
            if cls.kind == "negative_capacitance":
                values["capacitance"] = NEGATIVE_SHARE * self.seen.stick_capacitance
                note = f"C_n = {values['capacitance']:.4g} F in parallel, half the stability limit, without losses"
                return values, (note,)
            return values, ()
        values, notes = {}, []
        if issubclass(cls, Bridge) and not cls.whole_side:
            load = cls.gain**2 * np.pi / (2 * omega * capacitance)
            values |= {"load_resistance": load, "smoothing_capacitance": self._smoothing / load}
            notes.append(f"R C_s = {self._smoothing * self.frequency:g} periods")
        if issubclass(cls, SwitchedCoil):
            values["quality"], origin = self._device("quality", QUALITY)
            otherwise = self._switched_inductance(values["quality"])
            values["inductance"], same = self._device("inductance", otherwise, SwitchedCoil)
            inversion = np.exp(-np.pi / (2 * values["quality"]))
            notes.append(f"switched loop of quality {values['quality']:g}{origin} (inverts to {inversion:.2f} of the "
                         f"voltage) and {values['inductance']:.3g} H{same}")  # fmt: skip
        values |= self._diodes(cls, values, notes)
        values |= self._further_parts(cls, notes)
        values |= self._curves(cls, values, notes)
        own, note = cls.assumed(capacitance, self.frequency)
        values |= own
        notes += [note] if note else []
        if issubclass(cls, SynchronisedShunt) and self.operation.periodic and not self.operation.apart:
            # The default, a quarter of the common period of all tones, would let most extrema pass.
            values["hold_off"] = 0.25 / self.frequency
        return values, tuple(notes)

    def _diodes(self, cls: type[Shunt], values: Mapping[str, Any], notes: list[str]) -> dict[str, float]:
        """Diodes as the study's tables give them; where they have a curve that a circuit cannot have, a line for it."""
        found = {name: self._device(name, 0.0) for name in DIODE if name in cls.__dataclass_fields__}
        curved = next((s for s in self.templates if getattr(s, "diode_curve", None) is not None), None)
        if found and isinstance(curved, Bridge) and curved.diode_curve and not takes_diode_curve(cls):
            peak = self._peak_current(cls, values.get("inductance"))
            line = straight_diode(curved.diode_curve, peak)
            of_kind = {"diode_drop": line.mean_drop(peak)} if "diode_resistance" not in found else line.keys
            origin = f" as in the study's {curved.kind} at {peak:.2g} A"
            found |= {n: (getattr(curved, n) + of_kind[n], origin) for n in found if of_kind.get(n)}
        words = [f"{value:.4g} {unit_at(cls, name)}{origin}" for name, (value, origin) in found.items() if value]
        if found and (words or curved is None):
            notes.append(f"diodes of {', '.join(words)}" if words else "ideal diodes")
        return {name: value for name, (value, _) in found.items()}

    def _peak_current(self, cls: type[Shunt], inductance: float | None) -> float:
        """Scale of the current (A) through diodes: that of open electrodes which a coil discharges, or the motion."""
        if inductance is None and issubclass(cls, SynchronisedShunt):
            inductance = self._switched_inductance(QUALITY)  # of one that is not part of the model
        capacitance = self.leads.capacitance
        rate = 2 * np.pi * self.frequency if inductance is None else 1 / np.sqrt(inductance * capacitance)
        return float(self.leads.open_voltage * capacitance * rate)

    def _further_parts(self, cls: type[Shunt], notes: list[str]) -> dict[str, float]:
        """Further parts that the study's tables give; what each is is added to the remarks."""
        names = (*(COIL if issubclass(cls, SwitchedCoil) else ()), *BESIDE)
        found = {}
        for name in (n for n in names if n in cls.__dataclass_fields__):
            value, origin = self._device(name, 0.0, SwitchedCoil if name in COIL else Shunt)
            if value:
                found[name] = value
                notes.append(f"{name} = {value:g} {unit_at(cls, name)}{origin}")
        return found

    def _curves(self, cls: type[Shunt], values: Mapping[str, Any], notes: list[str]) -> dict[str, Component]:
        """Curves of diodes and loop that the study's tables give, where a circuit of this class can have them."""
        found: dict[str, Component] = {}
        names = [CURVES[0]] if takes_diode_curve(cls) else []
        if "core_resistance" not in values and "self_resonance" not in values:
            names += [name for name in CURVES[1:] if name in cls.__dataclass_fields__]
        names += [LOAD_CURVE] if "load_resistance" in values else []
        for name in names:
            shunt = next((shunt for shunt in self.templates if getattr(shunt, name, None) is not None), None)
            if shunt is not None:
                found[name] = getattr(shunt, name)
                notes.append(f"{name} as in the study's {shunt.kind}")
        return found

    def _device(self, name: str, otherwise: float, of: type[Shunt] = Shunt) -> tuple[float, str]:
        """A device's property as in the first template of a class that gives it, and a remark which this is.

        So that all candidates are compared with the same devices. Templates themselves stay as they are.
        """
        for shunt in (shunt for shunt in self.templates if isinstance(shunt, of)):
            value = getattr(shunt, name, None)
            if value:  # a diode without drop is one that the study does not speak of
                return float(value), f" as in the study's {shunt.kind}"
        return otherwise, ""

    def _unlike(self, drafts: Sequence[Draft]) -> list[str]:
        """Remarks on device properties that are not the same in all drafts."""
        found = []
        curved = any(getattr(d.shunt, "diode_curve", None) is not None for d in drafts)
        for name in (*(DIODE[2:] if curved else DIODE), "quality", *COIL, *BESIDE):
            have = [d for d in drafts if not isinstance(d.shunt, LinearShunt)]
            have = [d for d in have if getattr(d.shunt, name, None) is not None]
            values = {getattr(d.shunt, name) for d in have}
            if len(values) > 1:
                unit = unit_at(type(have[0].shunt), name)
                each = ", ".join(f"{f'{getattr(d.shunt, name):.4g} {unit}'.strip()} in {d.kind}" for d in have)
                found.append(f"candidates are not compared with the same devices: {name} is {each}")
        for name in (*CURVES, LOAD_CURVE):
            have = [d for d in drafts if name in type(d.shunt).__dataclass_fields__]
            have = [d for d in have if name != "diode_curve" or takes_diode_curve(type(d.shunt))]
            have = [d for d in have if name != LOAD_CURVE or getattr(d.shunt, "load_resistance", None) is not None]
            if len({getattr(d.shunt, name) for d in have}) > 1:
                without = ", ".join(d.kind for d in have if getattr(d.shunt, name) is None)
                which = f"{without} without {name}" if without else f"{name} is another one in some"
                found.append(f"candidates are not compared with the same devices: {which}")
        return found

    def _switched_inductance(self, quality: float) -> float:
        """Inductance in H that inverts the voltage in a share of the period, or faster where the limit requires it."""
        flip = FLIP_SHARE / self.frequency
        inductance = (flip / np.pi) ** 2 * (1 - 0.25 / quality**2) / self.seen.capacitance
        return float(min(inductance, self.options.max_inductance or np.inf))


def _blocking_share(transducer: Transducer, frequency: float, base: bool) -> float:
    """Voltage that holds sum T_i x_i against a drive, over that of open electrodes.

    The drive alone moves the charge q of shorted electrodes, a voltage v the charge -m v. The motion stops at q/m; open
    electrodes, where C v is the charge that the motion takes away, are at -q/(C + m).
    """
    opened, shorted = (frequency_response(System(transducer, s), frequency, base=base) for s in (Open(), Short()))
    with np.errstate(all="ignore"):
        both = -shorted.charge / opened.voltage  # C + m, F
        return float(np.abs(both / (both - transducer.capacitance)))


def any_harvests(shunt: Shunt, transducer: Transducer, period: float | None) -> bool:
    """True if a circuit, or one of its others, delivers power to a load."""
    electrodes = transducer.all_electrodes
    return any(harvests(each, electrodes[each.electrode].capacitance, period) for each in (shunt, *shunt.others))


def harvests(shunt: Shunt, capacitance: float, period: float | None) -> bool:
    """True if any configuration of a circuit, or its switch, delivers power to a load."""
    if any(np.any(state.recovered) for state in shunt.states(capacitance) if state.recovered is not None):
        return True
    states = [state.name for state in shunt.states(capacitance)]
    rows = np.eye(len(states) + 4)
    v, dv, i, one = rows[-4:]
    port = Port(v, dv, i, one, capacitance)
    z = SimpleNamespace(**dict(zip(states, rows, strict=False)))
    if any(shunt.powers(name, port, z).get("harvested") for name in shunt.configurations()):
        return True
    switch = shunt.switch(capacitance, period)
    return switch is not None and switch.efficiency > 0


def _needed(cls: type[Shunt], values: Mapping[str, Any]) -> list[str]:
    """Fields of a kind that have neither a value nor a default."""
    needed = (f for f in dataclasses.fields(cls) if f.init and f.default is MISSING and f.default_factory is MISSING)
    return [f.name for f in needed if f.name not in values]


def _parts(cls: type[Shunt]) -> dict[str, str]:
    """Resistances, inductances and capacitances that a kind requires, with their units."""
    fields = [f for f in dataclasses.fields(cls) if f.default is MISSING and f.metadata.get("unit") in _TUNED_UNITS]
    return {f.name: f.metadata["unit"] for f in fields}


def _entries(shunt: Shunt) -> list[str]:
    """Names of the parts that a shunt requires, of lists those of their entries."""
    lists = lists_of(type(shunt))
    found = [[f"{n}.{k}" for k, _ in enumerate(getattr(shunt, n))] if n in lists else [n] for n in _parts(type(shunt))]
    return [name for names in found for name in names]


def _distinct(drafts: list[Draft]) -> list[Draft]:
    """Drafts that differ in more than their initial values."""
    kept: dict[Any, Draft] = {}
    for draft in drafts:
        free = {prefix + name.partition(".")[0] for prefix, name in map(split, draft.free)}
        fixed = tuple(
            (shunt.kind, field.name, getattr(shunt, field.name))
            for prefix, shunt in draft.branches()
            for field in dataclasses.fields(shunt)
            if field.name != "others" and prefix + field.name not in free
        )
        kept.setdefault((draft.free, fixed), draft)
    return list(kept.values())


def retuned(
    drafts: Sequence[Draft], templates: Sequence[Shunt], named: Sequence[str], held: Sequence[str] = ()
) -> list[str]:
    """Sentence on the values of the study's shunts that are tuned, but for those `named` to be; none: no sentence.

    The key that it suggests goes on to hold what is `held` already.
    """
    kinds: dict[str, list[str]] = {}
    for draft in drafts:
        for name in (*draft.free, *draft.late):
            prefix, own = split(name)
            part, field_name = owner(draft.shunt, name)[0], own.partition(".")[0]
            default = part.__dataclass_fields__[field_name].default
            given = (prefix or draft.shunt in templates) and getattr(part, field_name) not in (None, default)
            if given and field_name not in named:
                kinds.setdefault(field_name, []).append(part.kind)
    if not kinds:
        return []
    values = ", ".join(f"{name} of {' and '.join(dict.fromkeys(found))}" for name, found in kinds.items())
    keys = ", ".join(f'"{name}"' for name in dict.fromkeys((*held, *kinds)))
    return [f"tuned, so values given in [[shunts]] are not used: {values}; design.hold = [{keys}] keeps them"]
