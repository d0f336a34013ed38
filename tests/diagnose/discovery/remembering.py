"""Records of specimens with a law that has a memory, made with SciPy alone; and the search for a law by itself."""

from __future__ import annotations

import numpy as np
from nameless import BEAM
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.signal import lsim

from piezoharvest.diagnose.discovery.search import search
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.identify.identification import identify
from piezoharvest.identify.preparation import prepared
from piezoharvest.threads import single_threaded

FINER = 20  # values of a reading for each sample, while it is filtered


def spring_with(memory, drive, load, duration, rate):
    """True channels of a beam whose spring has a memory: `memory(t, x, u, m)` returns its force and the rates of m.

    `memory.states` is their number. From rest; with errors far below those that a test tolerates.
    """
    with_force = lambda t, x, u, v, own: (memory(t, x, u, own)[0], 0.0, memory(t, x, u, own)[1])  # noqa: E731
    return device_with(with_force, memory.states, drive, load, duration, rate, method=memory.method)


def device_with(memory, states, drive, load, duration, rate, device=BEAM, method="LSODA"):
    """The same with `memory(t, x, u, v, m)` that returns a force beside the spring's, a current, and rates of m."""
    m, b, k, T, C = (device[name] for name in ("mass", "damping", "stiffness", "coupling", "capacitance"))

    def slopes(t, y):
        x, u, v, *own = y.tolist()
        force, current, rates = memory(t, x, u, v, own)
        return [u, (drive(t) - b * u - k * x - force + T * v) / m, -(v / load + current + T * u) / C, *rates]

    t = np.arange(round(duration * rate)) / rate
    # A memory may have corners, which longer steps would pass over.
    run = solve_ivp(slopes, (0, t[-1]), [0.0] * (3 + states), method, t, rtol=1e-9, atol=1e-13, max_step=0.25 / rate)
    x, _, v = run.y[:3]
    return {"time_s": t, "force": drive(t), "displacement": x, "voltage": v, "current": v / load}


def spring_behind_play(stiffness, half, drive, load, duration, rate, device=BEAM):
    """The same with a spring of what is left of x behind lost motion of +-half, from one end of the play to the next.

    There its rate jumps: within the play it stands still, at an end it moves along.
    """
    m, b, k, T, C = (device[name] for name in ("mass", "damping", "stiffness", "coupling", "capacitance"))
    t = np.arange(round(duration * rate)) / rate
    now, y, behind, end, found = 0.0, np.zeros(3), 0.0, 0, np.empty((3, len(t)))

    def piece():
        """Rates, and what ends this piece: the other way at an end, or an end reached within."""
        at = end  # of the play: 1, -1, or 0 within it

        def rates(t, y):
            x, u, v = y.tolist()
            left = x - at * half if at else behind
            return [u, (drive(t) - b * u - k * x - stiffness * left + T * v) / m, -(v / load + T * u) / C]

        ends = [lambda t, y: at * y[1]] if at else [lambda t, y, s=s: half - s * (y[0] - behind) for s in (1, -1)]
        for each in ends:
            each.terminal, each.direction = True, -1.0
        return rates, ends

    while now < t[-1]:
        rates, ends = piece()
        run = solve_ivp(
            rates, (now, t[-1]), y, "DOP853", dense_output=True, events=ends, rtol=1e-9, atol=1e-14, max_step=2 / rate
        )  # fmt: skip
        inside = (t >= now) & (t <= run.t[-1])
        found[:, inside] = run.sol(t[inside])
        now, y = run.t[-1], run.y[:, -1]
        behind = y[0] - end * half if end else behind
        end = 0 if end else next((s for s, each in zip((1, -1), run.t_events, strict=True) if len(each)), 0)
    x, _, v = found
    return {"time_s": t, "force": drive(t), "displacement": x, "voltage": v, "current": v / load}


def relaxing(weight, time_constant):
    """A Maxwell element: weight (x - y) beside the spring, of which weight x is the spring's own part."""

    def memory(t, x, u, own):
        return -weight * own[0], [(x - own[0]) / time_constant]

    memory.states, memory.method = 1, "LSODA"
    return memory


def resonating(weight, frequency, damping):
    """A second-order element that follows x."""
    w = 2.0 * np.pi * frequency

    def memory(t, x, u, own):
        return -weight * own[0], [w * own[1], w * (x - own[0] - 2.0 * damping * own[1])]

    memory.states, memory.method = 2, "LSODA"
    return memory


def rubbing(weight, threshold):
    """A stop: it follows x between its ends."""

    def memory(t, x, u, own):
        stuck = abs(own[0]) < threshold or own[0] * u < 0.0
        return weight * np.clip(own[0], -threshold, threshold), [u if stuck else 0.0]

    memory.states, memory.method = 1, "Radau"  # the rate jumps, where other methods take ever smaller steps
    return memory


def with_play(x, half):
    """A reading with a backlash: it stays until the truth has moved by half of it to one side."""
    found = np.empty_like(x)
    at = x[0]
    for n, value in enumerate(x):
        at = min(max(at, value - half), value + half)
        found[n] = at
    return found


def finely(t, x):
    """Times and values between the samples: a filter takes straight lines between those that it is given."""
    fine = np.linspace(t[0], t[-1], FINER * (len(t) - 1) + 1)
    return fine, CubicSpline(t, x)(fine)


def delayed(t, x, delay):
    """What was a while ago; before the record it was as at its first sample."""
    return CubicSpline(t, x)(np.maximum(t - delay, t[0]))


def lagging(t, x, time_constant):
    """A first-order lag, at rest with its first input."""
    t, x = finely(t, x)
    system = ([[-1.0 / time_constant]], [[1.0 / time_constant]], [[1.0]], [[0.0]])
    return lsim(system, x, t, [x[0]])[1][::FINER]


def ringing(t, x, frequency, damping):
    """A second-order lag of a sensor, at rest with its first input."""
    (t, x), w = finely(t, x), 2.0 * np.pi * frequency
    system = ([[0.0, 1.0], [-(w**2), -2.0 * damping * w]], [[0.0], [w**2]], [[1.0, 0.0]], [[0.0]])
    return lsim(system, x, t, [x[0], 0.0])[1][::FINER]


@single_threaded
def searched(campaign):
    """What a search finds in the fitted records of a campaign."""
    problem, before = fitted_without_law(campaign)
    return search(problem, before, lambda text: None)


def fitted_without_law(campaign):
    """The fitted records of a campaign, and the fit of the model without a law."""
    before = identify(campaign, offsets=("displacement",))
    return Problem(prepared(before.campaign, "fit"), before.campaign.transducer, before.offsets), before.found
