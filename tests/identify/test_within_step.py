"""Outputs of stops and hinges within a step against their definition, sample by sample."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit

from piezoharvest.predict.propagation.within_step import VARIABLES, hinge_with_corners, stop_with_corners

SHARES = np.linspace(0.0, 1.0, 20_001)
CASES = 40


@njit
def _found(of_stop, begin, limit, c, by_base, moments, found):
    """What Python may call: parts of compiled functions cannot be."""
    if of_stop:
        stop_with_corners(begin, limit, c, by_base, moments, found)
    else:  # begins from the input less the knot
        c[0] = begin + limit
        hinge_with_corners(limit, c, by_base, moments, found)


def _cubic(kind, variables):
    """Value at the end and coefficients of s (1 - s) and s^2 (1 - s), and their derivatives, (3, VARIABLES + 1)."""
    begin, limit, *c = variables
    found, moments, by_base = np.zeros((3, VARIABLES + 1)), np.zeros((2, VARIABLES + 1)), np.zeros(VARIABLES)
    _found(kind == "stop", begin, limit, np.array([7.0, *c]), by_base, moments, found)
    return found


def _by_definition(kind, variables):
    """Output at `SHARES`."""
    begin, limit, *c = variables
    moved = SHARES * (c[0] + SHARES * (c[1] + SHARES * c[2]))
    if kind == "hinge":
        return np.maximum(begin + moved, 0.0)
    output = [begin]
    for step in np.diff(moved):
        output.append(min(max(output[-1] + step, -limit), limit))
    return np.array(output)


def _variables(kind, seed):
    rng = np.random.default_rng(seed)
    limit = rng.uniform(0.2, 1.0)
    begin = np.clip(rng.uniform(-1.4, 1.4), -1.0, 1.0) * limit  # often at one of its thresholds
    c1, c2, c3 = rng.uniform(-4.0, 4.0, 3) * rng.choice([0.2, 1.0, 3.0])
    return [begin if kind == "stop" else rng.uniform(-0.5, 0.5), limit, c1, c2, c3]


@pytest.mark.parametrize("kind", ["stop", "hinge"])
def test_the_cubic_ends_at_the_output_and_has_its_mean_and_first_moment(kind):
    for seed in range(CASES):
        variables = _variables(kind, seed)
        output, found = _by_definition(kind, variables), _cubic(kind, variables)
        end, p, r = found[:, VARIABLES]
        cubic = output[0] * (1 - SHARES) + end * SHARES + (p + r * SHARES) * SHARES * (1 - SHARES)
        assert end == pytest.approx(output[-1], abs=1e-6), seed
        for weight in (1.0, SHARES):
            assert np.trapezoid(weight * cubic, SHARES) == pytest.approx(
                np.trapezoid(weight * output, SHARES), abs=1e-6
            )


@pytest.mark.parametrize("kind", ["stop", "hinge"])
def test_its_derivatives_are_those_of_central_differences(kind):
    for seed in range(CASES):
        variables, step = _variables(kind, seed), 1e-7
        if kind == "stop" and abs(variables[0]) == variables[1]:
            variables[0] *= 0.9  # at the threshold itself, differences to both sides are of two kinds
        found = _cubic(kind, variables)
        for v in range(VARIABLES) if kind == "stop" else (0, 2, 3, 4):
            up, down = list(variables), list(variables)
            up[v], down[v] = variables[v] + step, variables[v] - step
            slopes = (_cubic(kind, up) - _cubic(kind, down))[:, VARIABLES] / (2.0 * step)
            assert found[:, v] == pytest.approx(slopes, abs=1e-5), (seed, v)
