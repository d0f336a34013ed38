"""Mean and spread of a kind, and specimens of another, against dense normal distributions and draws of known truth."""

from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import minimize_scalar
from scipy.stats import multivariate_normal

from piezoharvest.population.hierarchy import Beliefs, Population, Said, estimated
from piezoharvest.population.oddness import odd_ones

USUAL = 0.2


def beliefs(count, deviation=1.0):
    return Beliefs(np.zeros(count), np.full(count, deviation), np.full(count, USUAL))


def test_what_records_say_is_the_posterior_without_its_prior():
    """A specimen whose records tell one of two values: the other's information is zero, however strong the prior."""
    rng, known = np.random.default_rng(1), beliefs(2)
    information = np.array([[400.0, 0.0], [0.0, 0.0]])
    posterior = np.linalg.inv(information + np.eye(2))
    told = rng.standard_normal(2)
    said = Said.of_posterior(posterior @ information @ told, posterior, known)
    np.testing.assert_allclose(said.information, information, atol=1e-10)
    assert said.mean[0] == pytest.approx(told[0], rel=1e-12)


def test_a_specimen_is_the_conditional_mean_of_a_dense_normal_distribution():
    """At a known spread: three specimens of two values, correlated errors, all unknowns and data in one covariance."""
    rng, spread, deviation = np.random.default_rng(2), np.array([0.1, 0.3]), 0.7
    roots = rng.standard_normal((3, 2, 2)) * 0.2
    errors = [root @ root.T + 1e-3 * np.eye(2) for root in roots]
    data = rng.standard_normal((3, 2))
    said = [Said(each, np.linalg.inv(error)) for each, error in zip(data, errors, strict=True)]
    # Covariance of the data, and of the first specimen's values with it: the mean has variance deviation^2.
    shared, own = deviation**2 * np.eye(2), np.diag(spread**2)
    of_data = np.block([[shared + (n == m) * (own + errors[n]) for m in range(3)] for n in range(3)])
    with_data = np.hstack([shared + (m == 0) * own for m in range(3)])
    solved = np.linalg.solve(of_data, np.column_stack([data.ravel(), with_data.T]))
    total = np.eye(2) / deviation**2 + sum(np.linalg.inv(own + error) for error in errors)
    right = sum(np.linalg.solve(own + error, each) for each, error in zip(data, errors, strict=True))
    kind = Population(np.linalg.solve(total, right), np.linalg.inv(total), spread)
    values, scatter = kind.shrunken(said[0])
    np.testing.assert_allclose(values, with_data @ solved[:, 0], rtol=1e-10)
    np.testing.assert_allclose(scatter, shared + own - with_data @ solved[:, 1:], rtol=1e-9, atol=1e-12)


def test_the_spread_is_between_the_mode_and_the_root_mean_square_of_its_posterior():
    """By a dense normal distribution and quadrature, for one value of five specimens."""
    data, errors = np.array([0.31, 0.12, 0.26, 0.05, 0.2]), np.array([0.02, 0.03, 0.02, 0.05, 0.03])
    found = estimated([Said(np.array([x]), np.array([[e**-2]])) for x, e in zip(data, errors, strict=True)], beliefs(1))

    def density(spread: float, power: int) -> float:
        of_data: Any = np.diag(errors**2 + spread**2) + np.ones((5, 5))  # the mean's own variance is 1
        weight = spread * np.exp(-0.5 * (spread / USUAL) ** 2)
        return spread**power * weight * multivariate_normal.pdf(data, np.zeros(5), of_data)

    best: Any = minimize_scalar(lambda spread: -density(spread, 0), bounds=(0.0, 1.0), method="bounded")
    mean_square = quad(density, 0.0, 1.5, args=(2,))[0] / quad(density, 0.0, 1.5, args=(0,))[0]
    assert 1.1 * best.x < found.spread[0] < np.sqrt(mean_square)


def test_the_least_measured_specimen_gains_most_and_its_errors_hold():
    """Sixty kinds of five specimens that differ by 5 %, the last of which is measured sixty times worse."""
    rng, known = np.random.default_rng(3), beliefs(2)
    alone, together, scores = [], [], []
    for _ in range(60):
        truth = rng.normal(0.0, 0.3, 2) + 0.05 * rng.standard_normal((5, 2))
        sizes = np.array([0.005] * 4 + [0.3])
        data = truth + sizes[:, None] * rng.standard_normal((5, 2))
        said = [Said(x, np.eye(2) / size**2) for x, size in zip(data, sizes, strict=True)]
        values, scatter = estimated(said, known).shrunken(said[-1])
        alone.append(data[-1] - truth[-1])
        together.append(values - truth[-1])
        scores.append(together[-1] / np.sqrt(np.diag(scatter)))
    assert np.std(together) < 0.3 * np.std(alone)  # 0.06 of 0.3, where nothing more can be had than 0.056
    # A normal distribution has 4.6 % beyond two; three standard errors of that share in 120 draws are 5.7 %.
    assert np.mean(np.abs(scores) > 2.0) < 0.046 + 0.057


def test_a_specimen_of_another_kind_is_told_and_none_of_a_wide_one():
    """Six specimens that agree within 2 %, one with half a value; and forty kinds of three with the usual spread."""
    rng, known = np.random.default_rng(4), beliefs(4)
    values = 0.02 * rng.standard_normal((6, 4))
    values[2, 1] -= np.log(2.0)
    assert odd_ones(values, np.full((6, 4), 0.005), known) == {2: (1,)}
    kinds = USUAL * rng.standard_normal((40, 3, 4))
    # One in 200 is told by mistake: two or more of 40 have a probability of 2 %.
    assert sum(bool(odd_ones(each, np.full((3, 4), 0.005), known)) for each in kinds) < 2
