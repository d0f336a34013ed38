"""What a user would do without a search for laws: the residuals of `identify`, regressed on the signals.

Sparse regression (PySINDy: Brunton, Proctor & Kutz, PNAS 113, 3932-3937, 2016) with powers of each signal to the fifth,
and Gaussian processes (scikit-learn: Rasmussen & Williams, Gaussian Processes for Machine Learning, 2006) with a length
for each signal. Both see the signals that the model predicts, its drive and the time, and are fitted to the fitted
records. Both are judged by what their prediction takes off the residual of records that they have not seen.

Neither knows of places. What a user would say is read from the channel whose residual is explained most, and the
signal that explains it; where that may be several places (a spring, or the reading of the displacement), each of them
counts as the right answer.
"""

from __future__ import annotations

import warnings
from importlib.util import find_spec
from typing import Any

import numpy as np

from piezoharvest.diagnose.residuals import Residuals
from reports.discovery.campaigns import FILES, FITTED, UNSEEN, Made, noise_of

SIGNALS = ("force", "displacement", "velocity", "voltage", "current", "time")
DEGREE = 5
THRESHOLDS = (0.3, 0.1, 0.03, 0.01)  # of the sparse regression, in standard deviations of the residual
SAMPLES = 600  # that a Gaussian process is fitted to: its cost goes with their cube
KEPT_BACK = 4  # every fourth block of the samples chooses the threshold
LENGTHS = (1e-2, 1e3)  # of Gaussian processes, in standard deviations of the signals
# What a user would conclude: channel with the residual, signal that it goes with.
PLACES: dict[tuple[str, str], tuple[tuple[str, str], ...]] = {
    ("displacement", "displacement"): (("spring", "displacement"), ("reading.displacement", "displacement")),
    ("displacement", "velocity"): (("damper", "velocity"),),
    ("displacement", "time"): (("parameter.stiffness", "time"), ("parameter.damping", "time")),
    ("voltage", "voltage"): (("electrodes", "voltage"), ("capacitor", "voltage"), ("reading.voltage", "voltage")),
    ("voltage", "displacement"): (("coupling", "displacement"),),
    ("current", "voltage"): (("load", "voltage"),),
}


def available() -> bool:
    """True if the packages of the extra `discovery` are there."""
    return all(find_spec(name) is not None for name in ("pysindy", "sklearn"))


def answers(records: list[Residuals], made: Made) -> dict[str, Any]:
    """By method: whether the place is among those it may mean, and its gain on the record that nobody has seen."""
    if not available():
        return {}
    unseen = next(each for each in records if each.data.name == UNSEEN)
    fitted = [each for each in records if each.data.name in FITTED]
    methods = {"sparse regression": _sparse, "gaussian process": _gaussian}
    return {name: _judged(method, fitted, unseen, made) for name, method in methods.items()}


def _signals(one: Residuals) -> np.ndarray:
    """What the model predicts, with drive and time, (samples, signals)."""
    data, step = one.data, one.data.setting.sample_time
    known = {name: data.record[name] - one.before[:, c] for c, name in enumerate(data.channels)}
    known[data.drive] = data.record[data.drive]
    known["velocity"] = np.gradient(known["displacement"], step)
    known["time"] = step * np.arange(len(data))
    return np.column_stack([known[name] for name in SIGNALS])


def errors(unseen: Residuals, made: Made) -> tuple[np.ndarray, np.ndarray]:
    """Errors of predictions of the unseen record before and after a diagnosis, in units of the noise, without it."""
    added = noise_of(made, FILES.index(UNSEEN))
    noise = np.column_stack([added[channel] for channel in unseen.data.channels])
    sigma = np.array([made.kind.noise[channel] for channel in unseen.data.channels])
    return (unseen.before - noise) / sigma, (unseen.after - noise) / sigma


def _judged(method: Any, fitted: list[Residuals], unseen: Residuals, made: Made) -> dict[str, Any]:
    x, y = (np.concatenate([part(each) for each in fitted]) for part in (_signals, lambda each: each.before))
    far, (left, _) = _signals(unseen), errors(unseen, made)
    centre, scale = x.mean(axis=0), x.std(axis=0) + 1e-300
    after, best = np.zeros_like(left), (-np.inf, "", "")
    for c, channel in enumerate(fitted[0].data.channels):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of matrices that are ill-conditioned, and of ends of length scales
            noise = made.kind.noise[channel]
            predicted, of, explained = method((x - centre) / scale, y[:, c] / noise, (far - centre) / scale)
        after[:, c] = left[:, c] - predicted
        best = max(best, (explained, channel, of))
    _, channel, of = best
    means = (*PLACES.get((channel, of), ()), (f"reading.{channel}", of))
    gain = float(np.clip(1.0 - squares(after) / squares(left), -1.0, 1.0))
    return {"right": made.site in means, "gain": gain, "said": [channel, of]}


def squares(values: np.ndarray) -> float:
    """Sum of squares."""
    return float(np.sum(values**2))


def _sparse(x: np.ndarray, y: np.ndarray, far: np.ndarray) -> tuple[np.ndarray, str, float]:
    """Prediction of a residual, the signal that explains it, and by how many squares."""
    import pysindy

    size = float(y.std()) or 1.0
    back = (np.arange(len(y)) * 40 // len(y)) % KEPT_BACK == 0
    library = pysindy.PolynomialLibrary(degree=DEGREE, include_interaction=False)

    def model(threshold: float, rows: np.ndarray) -> Any:
        made = pysindy.SINDy(optimizer=pysindy.STLSQ(threshold=threshold, alpha=1e-3), feature_library=library)
        return made.fit(x[rows], t=1.0, x_dot=np.column_stack([y[rows] / size] * x.shape[1]))

    tried = {threshold: model(threshold, ~back) for threshold in THRESHOLDS}
    loss = {
        threshold: squares(np.asarray(each.predict(x[back]))[:, 0] * size - y[back])
        for threshold, each in tried.items()
    }
    best = model(min(loss, key=lambda threshold: loss[threshold]), np.ones(len(y), bool))
    terms, weights = np.asarray(best.feature_library.transform(x)), best.coefficients()[0]
    parts = {}
    for k, name in enumerate(SIGNALS):
        mine = [j for j, term in enumerate(best.get_feature_names()) if term.split("^")[0] == f"x{k}"]
        parts[name] = float(np.var(terms[:, mine] @ weights[mine]))
    of = max(parts, key=lambda name: parts[name])
    explained = squares(y) - squares(y - np.asarray(best.predict(x))[:, 0] * size)
    return np.asarray(best.predict(far))[:, 0] * size, of, explained


def _gaussian(x: np.ndarray, y: np.ndarray, far: np.ndarray) -> tuple[np.ndarray, str, float]:
    """The same by a Gaussian process; the signal is that of the shortest length."""
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    some = np.random.default_rng(0).choice(len(y), min(SAMPLES, len(y)), replace=False)
    lengths = RBF([3.0] * x.shape[1], LENGTHS)
    kernel = ConstantKernel(float(y.var()), (1e-4, 1e8)) * lengths + WhiteKernel(1.0, (0.5, 2.0))
    model = GaussianProcessRegressor(kernel, random_state=0).fit(x[some], y[some])
    found: Any = model.kernel_
    of = SIGNALS[int(np.argmin(found.k1.k2.length_scale))]
    explained = squares(y) - squares(y - model.predict(x))
    return np.asarray(model.predict(far)), of, explained


__all__ = ["answers", "available"]
