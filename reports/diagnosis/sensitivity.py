"""Right answers on the held-out campaigns, and with every threshold of the diagnosis 30 % smaller and larger."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict
from datetime import UTC, datetime
from typing import Any, NamedTuple
from unittest.mock import patch

from threadpoolctl import threadpool_limits

from piezoharvest.diagnose import diagnosis, thresholds, validation
from piezoharvest.diagnose.residual_structure import residual_tests
from piezoharvest.diagnose.selection import candidate_fits
from piezoharvest.diagnose.thresholds import Threshold
from piezoharvest.identify.fitting import evaluation
from reports.diagnosis.summary import Results
from reports.diagnosis.trials import Trial, bench_of, library_of, read_back, right
from reports.diagnosis.varied import Key, Varied

FACTORS = (0.7, 1.3)
TABLE = {name: value for name, value in vars(thresholds).items() if isinstance(value, Threshold)}
# Thresholds on which the residual tests themselves depend, beside their level, and the scales of start values.
OF_TESTS = (
    "MIN_LINES", "SLOW_LINES", "MAX_CONSTANT_STEP", "MIN_CONSTANT_SHARE", "MIN_ROUNDING_ERROR", "MIN_SINE_SHARE",
)  # fmt: skip
OF_SCALES = ("MIN_SINE_SHARE", "MIN_TENSION", "MIN_LIMIT_GAIN", "MAX_PINNED_OFFSET", "MAX_SPIKE_SHARE", "NOISE_MARGIN")


class Line(NamedTuple):
    """Results of one threshold: right answers with each factor, and the campaigns whose answer it changes."""

    name: str
    value: float
    right: tuple[int, ...]
    tried: int
    changed: int
    steady: tuple[float, float]


def attempt(trial: Trial) -> dict[str, Any]:
    """Diagnose a held-out campaign with all thresholds, and with each that comes close to deciding otherwise varied.

    Only whether the answer is right is kept.
    """
    with threadpool_limits(1), patch.object(evaluation, "cores", lambda: 1), _remembered():
        campaign, library, close = read_back(bench_of(trial)[0]), library_of(trial), set[Key]()

        def answer(values: dict[str, float]) -> bool:
            try:
                with patch.multiple(thresholds, **values):
                    found = diagnosis.diagnose(campaign, library=library)
            except Exception:  # a failure is no right answer
                return False
            return right(trial, found.verdict, found)

        began = time.process_time()
        base = answer({name: _varied(name, close) for name in TABLE})
        plain = {name: float(value) for name, value in TABLE.items()}
        changed = {
            f"{name} {factor:g}": answer({**plain, name: factor * plain[name]}) for name, factor in sorted(close)
        }
    return {
        "key": trial.key, **asdict(trial), "diagnosed": datetime.now(UTC).isoformat(timespec="minutes"),
        "cpu": time.process_time() - began, "right": base, "varied": changed,
    }  # fmt: skip


def _varied(name: str, close: set[Key]) -> Varied:
    value = float(TABLE[name])
    return Varied(value, {(name, factor): factor * value for factor in FACTORS}, close)


@contextmanager
def _remembered() -> Iterator[None]:
    """Fits, scores and residual tests that were made before are not made again, for one campaign."""

    def roles(data: Any) -> tuple:
        return tuple((each.name, each.role, len(each)) for each in data)

    def values(names: Sequence[str]) -> tuple:
        return tuple(float(getattr(thresholds, name)) for name in names)

    def prepared(campaign: Any, role: str) -> tuple:
        return roles(campaign.records), campaign.transducer.quasi_static, role

    def identified(campaign: Any, **options: Any) -> tuple:
        near = options.pop("near", None)
        return roles(campaign.records), campaign.transducer.quasi_static, id(near), repr(options)

    def fitted(problem: Any, model: Any, own: Any = None, noise: Any = None, **options: Any) -> tuple:
        start = None if own is None else tuple(each.tobytes() for each in own)
        white = tuple(map(id, options.pop("white", None) or ()))
        plain = {name: float(value) for name, value in options.items()}
        return roles(problem.data), repr(model), start, repr(noise), white, tuple(sorted(plain.items()))

    def scored(problem: Any, found: Any, scales: Any, library: Any) -> tuple:
        return roles(problem.data), id(found), repr(scales)

    def scaled(data: Any, found: Any) -> tuple:
        return roles(data), id(found), values(OF_SCALES)

    def squared(problem: Any, found: Any) -> tuple:
        return roles(problem.data), id(found)

    def tested(problem: Any, found: Any, drive_noise: bool = True) -> tuple:
        return roles(problem.data), id(found), drive_noise, values(OF_TESTS)

    keys = {
        diagnosis: {"prepared": prepared, "identify": identified, "whitened_squares": squared},
        validation: {"prepared": prepared, "fit": fitted},
        candidate_fits: {"fit": fitted, "scores": scored, "campaign_scales": scaled},
        residual_tests: {"run_tests": tested},
    }
    with ExitStack() as stack:
        for module, some in keys.items():
            for name, key in some.items():
                stack.enter_context(patch.object(module, name, _memory(getattr(module, name), key)))
        yield


def _memory(function: Callable[..., Any], key: Callable[..., tuple]) -> Callable[..., Any]:
    """Function that remembers its results, and what they were made of, so that no identity is used twice."""
    known: dict[tuple, tuple[Any, Any]] = {}

    def remembered(*args: Any, **options: Any) -> Any:
        place = key(*args, **options)
        if place not in known:
            known[place] = function(*args, **options), (args, options)
        return known[place][0]

    return remembered


def lines(results: Results) -> list[Line]:
    """Right answers of all campaigns with every threshold varied, one line a threshold."""
    found = []
    for name, value in TABLE.items():
        answers = {
            factor: [row["varied"].get(f"{name} {factor:g}", row["right"]) for row in results] for factor in FACTORS
        }
        base = [row["right"] for row in results]
        tried = sum(any(f"{name} {factor:g}" in row["varied"] for factor in FACTORS) for row in results)
        changed = sum(any(one != other for one in each) for *each, other in zip(*answers.values(), base, strict=True))
        low, high = (factor if sum(answers[factor]) == sum(base) else 1.0 for factor in FACTORS)
        rights = (sum(answers[FACTORS[0]]), sum(base), sum(answers[FACTORS[1]]))
        found.append(Line(name, float(value), rights, tried, changed, (low, high)))
    return found
