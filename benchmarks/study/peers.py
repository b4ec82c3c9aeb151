"""What others would do with the residual of the base model on the same trials; scored at new conditions.

Each peer learns the residual of the training sessions' trials and predicts that of new trials whose phase and
bias are known as well as tracing knows them. `gp`: one periodic process on time, as in the paper.
`sparse`: harmonics of the spindle angle times polynomials of the conditions, thinned by sequential
thresholding (STLSQ, as PySINDy does). `neural`: a small network on the same inputs.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.tracing.fitting.prediction import Prediction
from mjx_cutting.trials.dataset import Dataset, Trial

from .generator import Case

Array = NDArray[np.float64]
SAMPLES = 20_000
_DEGREE = 2
_THRESHOLD = 0.05


class Conditions:
    """Speed, feed and depth of a trial in units of the training session's spread, [3]."""

    def __init__(self, trials: Sequence[Trial]) -> None:
        raw = np.array([self._raw(trial) for trial in trials])
        self.middle, self.spread = raw.mean(0), np.where(raw.std(0) > 1e-9, raw.std(0), 1.0)

    @staticmethod
    def _raw(trial: Trial) -> Array:
        return np.array([trial.spindle_speed_rev_s, trial.feed_speed_m_s * 1e3, trial.radial_depth_m * 1e3])

    def of(self, trial: Trial) -> Array:
        """Scaled conditions of a trial."""
        return (self._raw(trial) - self.middle) / self.spread


def unbiased(case: Case) -> Dataset:
    """The session less its true biases: every peer and the traced model are spared them alike."""
    biases = {file: np.asarray(told["bias_n"]) for file, told in case.truth["trials"].items()}
    trials = [replace(trial, force_n=trial.force_n - biases[trial.file]) for trial in case.dataset.trials]
    return replace(case.dataset, trials=tuple(trials))


def cuts(dataset: Dataset) -> list[Trial]:
    """The trials that cut."""
    return [trial for trial in dataset.trials if trial.kind == "cut"]


def nrmse(predictions: Sequence[Prediction], added: Sequence[Array] | None = None) -> float:
    """RMS of what is left over RMS of what was measured, trials pooled."""
    extra = added if added is not None else [np.zeros_like(p.residual_n) for p in predictions]
    left = np.concatenate([p.residual_n - more for p, more in zip(predictions, extra, strict=True)])
    return float(
        np.sqrt(np.mean(left**2) / np.mean(np.concatenate([p.measured_n for p in predictions]) ** 2))
    )


def _turned(angle: Array, teeth: int, orders: Sequence[int]) -> Array:
    """[teeth, T, 2 K] harmonics of the angle, seen from each tooth (which is tooth 0 is unknown)."""
    turns = angle + 2.0 * np.pi * np.arange(teeth)[:, None] / teeth
    waves = turns[..., None] * np.asarray(orders)
    return np.concatenate([np.cos(waves), np.sin(waves)], axis=-1)


def _orders(teeth: int) -> list[int]:
    return sorted({1, 2, 3, teeth - 1, teeth, teeth + 1, 2 * teeth} - {0})


def _aligned(predictions: Sequence[Prediction], teeth: int) -> list[int]:
    """The tooth from which each trial's residual looks most like the others'."""
    orders = np.arange(1, teeth)
    if teeth < 2:
        return [0] * len(predictions)
    lines = [
        np.exp(-1j * orders * p.angle_rad[:, None]).T @ p.residual_n / len(p.time_s) for p in predictions
    ]
    turn = np.exp(-2j * np.pi * np.outer(np.arange(teeth), orders) / teeth)
    reference = max(lines, key=lambda line: float(np.linalg.norm(line)))
    return [
        int(np.argmax([np.sum((line * t[:, None]) * reference.conj()).real for t in turn])) for line in lines
    ]


def _polynomials(conditions: Array) -> Array:
    a, b, c = conditions
    return np.array([1.0, a, b, c, a * a, b * b, c * c, a * b, a * c, b * c][: 10 if _DEGREE == 2 else 4])


def sparse(
    train: Dataset, known: Sequence[Prediction], new: Dataset, asked: Sequence[Prediction]
) -> list[Array]:
    """STLSQ on harmonics times polynomials; returns the predicted residuals of the new trials."""
    teeth, scale = train.tool.teeth, Conditions(cuts(train))
    orders, tooth = _orders(teeth), _aligned(known, teeth)
    rows, seen = [], []
    each = max(200, SAMPLES // len(known))
    for trial, p, j in zip(cuts(train), known, tooth, strict=True):
        pick = np.linspace(0, len(p.time_s) - 1, min(each, len(p.time_s))).astype(int)
        waves = np.column_stack([np.ones(len(pick)), _turned(p.angle_rad[pick], teeth, orders)[j]])
        rows.append(np.kron(waves, _polynomials(scale.of(trial))[None]).reshape(len(pick), -1))
        seen.append(p.residual_n[pick])
    library, target = np.concatenate(rows), np.concatenate(seen)
    norm = np.sqrt(np.mean(library**2, 0)) + 1e-12
    weights = stlsq(library / norm, target) / norm[:, None]
    made = []
    for trial, p in zip(cuts(new), asked, strict=True):
        polynomial = _polynomials(scale.of(trial))
        options = []
        for waves in _turned(p.angle_rad, teeth, orders):
            full = np.column_stack([np.ones(len(waves)), waves])
            coefficients = weights.reshape(full.shape[1], len(polynomial), -1)
            options.append(full @ np.einsum("kpc,p->kc", coefficients, polynomial))
        made.append(_best(options, p))
    return made


def stlsq(library: Array, target: Array, rounds: int = 10) -> Array:
    """Sequentially thresholded least squares: small terms out (relative to the target), fit again."""
    gram, moment = library.T @ library, library.T @ target
    ridge = 1e-6 * np.trace(gram) / len(gram)
    scale = target.std(0) + 1e-12
    active = np.ones((len(gram), target.shape[1]), bool)
    weights = np.zeros(active.shape)
    for _ in range(rounds):
        for axis in range(target.shape[1]):
            on = active[:, axis]
            weights[:, axis] = 0.0
            if on.any():
                inner = gram[np.ix_(on, on)] + ridge * np.eye(int(on.sum()))
                weights[on, axis] = np.linalg.solve(inner, moment[on, axis])
        kept = np.abs(weights) >= _THRESHOLD * scale
        if (kept == active).all():
            break
        active &= kept
    return weights


def neural(
    train: Dataset, known: Sequence[Prediction], new: Dataset, asked: Sequence[Prediction]
) -> list[Array]:
    """A network of two layers of 32 on harmonics and conditions."""
    from sklearn.neural_network import MLPRegressor

    teeth, scale = train.tool.teeth, Conditions(cuts(train))
    orders, tooth = _orders(teeth), _aligned(known, teeth)
    rows, seen = [], []
    each = max(200, SAMPLES // len(known))
    for trial, p, j in zip(cuts(train), known, tooth, strict=True):
        pick = np.linspace(0, len(p.time_s) - 1, min(each, len(p.time_s))).astype(int)
        waves = _turned(p.angle_rad[pick], teeth, orders)[j]
        rows.append(np.column_stack([waves, np.tile(scale.of(trial), (len(pick), 1))]))
        seen.append(p.residual_n[pick])
    target = np.concatenate(seen)
    spread = target.std(0) + 1e-12
    network = MLPRegressor(hidden_layer_sizes=(32, 32), early_stopping=True, max_iter=80, random_state=0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # stopped at max_iter: this peer is given that much and no more
        network.fit(np.concatenate(rows), target / spread)
    made = []
    for trial, p in zip(cuts(new), asked, strict=True):
        conditions = np.tile(scale.of(trial), (len(p.time_s), 1))
        views = _turned(p.angle_rad, teeth, orders)
        views = views[:: max(1, teeth // 5)]
        made.append(_best([network.predict(np.column_stack([w, conditions])) * spread for w in views], p))
    return made


def gp(train: Dataset, known: Sequence[Prediction], new: Dataset, asked: Sequence[Prediction]) -> list[Array]:
    """One periodic process on time, shared by all trials; a new trial may choose its moment in the period."""
    from mjx_cutting.disturbance import fit

    length = min(len(p.time_s) for p in known)
    residual = np.stack([p.residual_n[:length] for p in known])
    process = fit(known[0].time_s[:length], residual, diagnose=False, starts=8, trial_effects=False)
    made = []
    for p in asked:
        shifts = process.period_s * np.arange(24) / 24.0
        made.append(_best([process.predict(p.time_s + shift)[0] for shift in shifts], p))
    return made


def _best(options: Sequence[Array], p: Prediction) -> Array:
    """The option nearest to what was measured: the free phase of a trial."""
    return min(options, key=lambda each: float(np.sum((p.residual_n - each) ** 2)))


PEERS: dict[str, Any] = {"gp": gp, "sparse": sparse, "neural": neural}
