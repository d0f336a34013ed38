"""Optimal damping of one mode by RL shunts, and of several modes by shunts with a branch for each."""

import numpy as np
import pytest
from scipy.optimize import minimize

from piezoharvest import design
from piezoharvest.description.excitation import RandomForce, SineForce
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import CurrentBlocking, CurrentFlowing, ParallelBranches, Resistor, SeriesRL, Short
from piezoharvest.description.system import System
from piezoharvest.description.transducer import Mode
from piezoharvest.design.drafts import Draft, Drafting
from piezoharvest.design.goal import Goal
from piezoharvest.design.linear_view import LinearView
from piezoharvest.design.operation import operation_of
from piezoharvest.design.tuning.branches import branch_values
from piezoharvest.design.tuning.minimax import tune
from piezoharvest.design.tuning.region import Region
from piezoharvest.design.tuning.starts import Host, starts
from piezoharvest.linear import admittance, frequency_response
from piezoharvest.study import DesignOptions, Study

FORCE = 0.02
SECOND = Mode(mass=0.01, stiffness=9 * 986.96, damping=0.06, coupling=2e-3)


def view_of(transducer, excitation=None, **options):
    """The two-port of a design for damping."""
    goal = Goal(DesignOptions(objective="damping", **options))
    sine = SineForce(amplitude=FORCE, frequency=50.0)
    return LinearView(transducer, operation_of(excitation or sine, goal.options.band, transducer), goal)


def tuned(view, draft, formula=""):
    """The best from all starts, or from those of one formula."""
    host = Host.of(view)
    region, found = Region.of(draft, host, None), [s for s in starts(draft, host) if formula in s.formula]
    return min((tune(view, draft, start, region) for start in found), key=lambda found: found.merit)


def draft_of(cls, **values):
    return Draft(cls(**values), tuple(values))


def largest(values, k, frequencies):
    """Peak over static displacement with a series RL shunt, from the two equations of motion written down here.

    Frequencies are relative to the short-circuit resonance, the shunt has L C w_sc^2 = a and R C w_sc = b.
    """
    a, b = np.exp(values)
    s = 1j * frequencies
    electrical = a * s**2 + b * s + 1  # of q/(T x), with the voltage (q - T x)/C
    return np.max(np.abs(1 / (s**2 + 1 + k**2 * (1 - 1 / electrical))))


@pytest.mark.parametrize(
    ("k", "peak"), [(0.02, 70.7005), (0.05, 28.2589), (0.1, 14.0917), (0.2, 6.9721), (0.3, 4.5705), (0.5, 2.6117)]
)
def test_series_rl_reaches_the_smallest_peak(host, k, peak):
    """To five digits, for an undamped mode; figures of a search by others."""
    transducer = host(k**2)
    view = view_of(transducer, band=(50 * (1 - k), 50 * (1 + 2 * k)))
    best = tuned(view, draft_of(SeriesRL, inductance=250.0, resistance=1e4), "Yamada")
    found = view.figures(best.shunt).displacement_amplitude * transducer.stiffness / FORCE
    assert found == pytest.approx(peak, rel=1.5e-5)
    # And as good as what a search without derivatives finds near it, on a dense grid.
    w, c = np.sqrt(transducer.stiffness / transducer.mass), transducer.capacitance
    at = np.log([best.shunt.inductance * c * w**2, best.shunt.resistance * c * w])
    grid = np.linspace(1 - k, 1 + 2 * k, 4001)
    other = minimize(
        largest, at + np.array([0.01, -0.1]), args=(k, grid), method="Nelder-Mead", options={"fatol": 1e-9}
    )
    assert found <= other.fun * (1 + 1e-5)


def test_resonance_without_damping_on_the_grid(host):
    """At the pole the equations are singular: the peak is found to be very high, where it raised an error."""
    transducer = host(0.01)
    view = view_of(transducer, band=(40.0, 65.0))
    exact = np.array([transducer.short_circuit_frequency])
    assert np.abs(view.response(Short(), exact).displacement[0]) * transducer.stiffness > 1e9
    assert view.figures(Short()).displacement_amplitude * transducer.stiffness / FORCE > 1e6


@pytest.mark.parametrize("cls", [Resistor, SeriesRL])
def test_smallest_mean_square_under_white_noise(host, cls):
    """Against a search without derivatives on the mean square over a dense grid."""
    transducer = host(0.04, 100)
    noise = RandomForce(psd=1e-4, band=(1.0, 400.0), duration=1.0, seed=1)
    view = view_of(transducer, noise)
    draft = draft_of(cls, **{"resistance": 1e4, **({"inductance": 250.0} if cls is SeriesRL else {})})
    best = tuned(view, draft)
    f = np.concatenate((np.linspace(1, 35, 200), np.linspace(35, 75, 4001)[1:], np.geomspace(75, 400, 300)[1:]))

    def mean_square(logs):
        shunt = draft.with_values(dict(zip(draft.free, map(float, np.exp(logs)), strict=True)))
        x = frequency_response(System(transducer, shunt), f).displacement
        return 1e-4 * np.trapezoid(np.abs(x) ** 2, f)

    at = np.log([getattr(best.shunt, name) for name in draft.free])
    brute = minimize(mean_square, at + 0.1, method="Nelder-Mead", options={"xatol": 1e-6, "fatol": 1e-16})
    # Displacement of the view is the amplitude of a sine with the same mean square.
    assert view.figures(best.shunt).displacement_amplitude ** 2 / 2 == pytest.approx(brute.fun, rel=1e-4)
    assert mean_square(at) <= brute.fun * (1 + 1e-6)


@pytest.fixture
def two_modes(host):
    return host(0.025, 150, modes=(SECOND,))


@pytest.mark.parametrize("kind", ["current_flowing", "parallel_branches", "current_blocking"])
def test_starts_resonate_at_every_mode(two_modes, kind):
    """Without losses electrodes and shunt together have no susceptance at each open-circuit resonance."""
    view = view_of(two_modes, band=(40.0, 170.0))
    draft = Drafting(two_modes, (), DesignOptions(candidates=(kind,)), view.operation).drafts()[0]
    modes = view.operation.modes(two_modes)
    assert len(modes) == 2 and len(draft.shunt.inductances) == 2
    for _, values in branch_values(draft.shunt, modes, two_modes.capacitance):
        free = {n: 1e-6 if n.startswith("resistances") else v for n, v in values.items()}
        shunt = draft.with_values(free)
        for _, w in modes:
            # Next to the blocking circuits' own frequencies, where they are infinite.
            f = w * (1 + 1e-9) / (2 * np.pi)
            found = admittance(shunt, f) + 2j * np.pi * f * two_modes.capacitance
            assert abs(found) < 1e-5 * 2 * np.pi * f * two_modes.capacitance


def test_a_branch_for_each_mode_damps_both(two_modes):
    """By 4 dB more than the best of one resonance, and no random neighbour is better."""
    view = view_of(two_modes, band=(40.0, 170.0))
    one = tuned(view, draft_of(SeriesRL, inductance=250.0, resistance=1e4), "rule")
    options = DesignOptions(candidates=("parallel_branches",))
    draft = Drafting(two_modes, (), options, view.operation).drafts()[0]
    host = Host.of(view)
    start = starts(draft, host)[0]
    best = tune(view, draft, start, Region.of(draft, host, None))
    found, single = view.figures(best.shunt), view.figures(one.shunt)
    assert found.attenuation_db < single.attenuation_db - 4
    rng = np.random.default_rng(3)
    values = Draft(best.shunt, draft.free).first()
    near = {n: v * np.exp(0.1 * rng.normal(size=(200, 1))) for n, v in values.items()}
    others = view.sampled(draft.with_values(near), view.survey(best.shunt))
    assert found.displacement_amplitude <= min(o.displacement_amplitude for o in others) * (1 + 1e-6)


def test_lists_in_designs(two_modes, run):
    """Entries of lists are tuned, rounded and held by name."""
    template = CurrentFlowing(inductances=(500.0, 60.0), resistances=(2e4, 1e4), capacitances=(4e-8, 4e-8))
    result = run(
        two_modes, 50.0, shunts=[template], candidates=("current_flowing",), parts="E12",
        hold=("capacitances", "inductances"),
    )  # fmt: skip
    best = result.best
    assert best.shunt.inductances == template.inductances and best.shunt.resistances != template.resistances
    assert best.parts is not None and set(best.parts.values) == {"resistances.0", "resistances.1"}
    assert best.as_json()["shunt"]["resistances"] == list(best.shunt.resistances)
    assert best.shunt.resistances[0] == best.parts.values["resistances.0"]


def test_one_mode_needs_no_branches(host, run):
    """A shunt with a branch for each mode is left out, with the reason, where there is one mode."""
    result = run(host(0.05, 60), 50.0, candidates=("resistor", "current_blocking"))
    assert [c.shunt.kind for c in result.candidates] == ["resistor"]
    assert any("fewer than two modes" in note for note in result.notes)


def test_lengths_of_lists():
    with pytest.raises(ParameterError, match=r"capacitances: found 2 values for 2 branches, allowed are 1"):
        ParallelBranches(inductances=(1.0, 2.0), resistances=(1.0, 2.0), capacitances=(1.0, 2.0))
    with pytest.raises(ParameterError, match=r"blocking_inductances: found 1 value "):
        CurrentBlocking(
            inductances=(1.0, 2.0),
            resistances=(1.0, 2.0),
            blocking_inductances=(1.0,),
            blocking_capacitances=(1.0, 1.0),
        )


@pytest.mark.parametrize("limits", [{}, {"min_power": 1e-9}])
def test_a_power_that_does_not_count_is_not_computed_while_tuning(host, monkeypatch, limits):
    """The mean over a band takes hundreds of frequencies for each design, and its peaks take a few.

    Three branches on two patches were tuned for longer than ten minutes; nearly all of that was this mean.
    """
    two = host(0.025, 150, modes=(SECOND,))
    view = view_of(two, band=(35.0, 180.0), **limits)
    nodes, sizes, response = len(view.operation.frequencies), [], LinearView.response

    def recorded(self, shunt, frequencies):
        sizes.append(len(frequencies))
        return response(self, shunt, frequencies)

    monkeypatch.setattr(LinearView, "response", recorded)
    draft = draft_of(SeriesRL, inductance=250.0, resistance=2e4)
    found = tuned(view, draft, "pole placement")
    assert (sum(size >= nodes for size in sizes) > 10) == bool(limits)
    assert found.merit == view.goal.merit(view.figures(found.shunt))


@pytest.mark.parametrize(
    ("modes", "excitation", "said"),
    [
        ((SECOND,), SineForce(amplitude=FORCE, frequency=50.0), "what a shunt takes here is shared by 2 modes"),
        ((), RandomForce(psd=1e-6, band=(30.0, 80.0), duration=1.0, seed=1), "and the excitation is random_force"),
        ((), SineForce(amplitude=FORCE, frequency=50.0), None),
    ],
)
def test_it_is_said_why_no_added_damping_is_given(host, modes, excitation, said):
    """The column was left out without a word."""
    options = DesignOptions(objective="damping", candidates=("resistor",))
    found = design(Study(transducer=host(0.025, 150, modes=modes), excitation=excitation, design=options))
    notes = [note for note in found.notes if note.startswith("no added damping is given: ")]
    assert (found.candidates[0].added_damping is None) == bool(said) == (len(notes) == 1)
    assert said is None or said in notes[0]
