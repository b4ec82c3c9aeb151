"""Error on trials that a fit has not seen: leave one trial out, or ten folds by trial, or by tool.

Heldout NRMSE is the root mean square of (measured - predicted) over samples and axes of the held-out cut
trials, over that of the measured force, both within the trusted band. A held-out trial's own phase, speed
error and (where zeroed per trial) bias are fitted on it, nothing else. Trials are the independent units;
samples never are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjx_cutting.tracing.fitting.descent import Descent
from mjx_cutting.tracing.fitting.fit import Effects, Fit
from mjx_cutting.tracing.fitting.growth import growth_n2
from mjx_cutting.tracing.fitting.prediction import grows
from mjx_cutting.tracing.fitting.problem import Problem
from mjx_cutting.tracing.records.lines import Lines, whole_file
from mjx_cutting.trials.dataset import Dataset

FOLDS = 10
ONE_BY_ONE = 12
_SEVERAL_TOOLS = 3
_STEPS = 6


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Squared errors on held-out trials.

    Fields:
        error_n2: [R, 3] sum over samples of the squared error of each trial and axis, N^2; of its pieces
            together, where trials were cut in pieces.
        energy_n2: [R, 3] the same of the measured force.
        fits: the fit of each fold, fields [F, ...]; None where only something was added to them.
        fold: [R] fold in which each trial was held out.
    """

    error_n2: NDArray[np.floating]
    energy_n2: NDArray[np.floating]
    fits: Fit | None
    fold: NDArray[np.int64]

    @property
    def nrmse(self) -> float:
        """Over all trials and axes."""
        return float(np.sqrt(self.error_n2.sum() / self.energy_n2.sum()))

    @property
    def per_axis(self) -> NDArray[np.floating]:
        """[3] each axis against its own force."""
        return np.sqrt(self.error_n2.sum(axis=0) / np.maximum(self.energy_n2.sum(axis=0), 1e-30))

    @property
    def per_trial(self) -> NDArray[np.floating]:
        """[R] each trial against its own force."""
        return np.sqrt(self.error_n2.sum(axis=1) / np.maximum(self.energy_n2.sum(axis=1), 1e-30))

    def only(self, kept: NDArray[np.bool_]) -> HeldOut:
        """The errors of some of the trials, `kept` [R]."""
        return HeldOut(self.error_n2[kept], self.energy_n2[kept], None, self.fold[kept])


def folds(dataset: Dataset, seed: int) -> NDArray[np.int64]:
    """[R] fold of each cut trial: by tool where there are several, else by trial (ten if over 12). Two tools
    are not several: from the difference of two fits nobody can tell how sure a parameter is."""
    trials = list({whole_file(trial.file): trial for trial in dataset.trials if trial.kind == "cut"}.values())
    tools = [trial.tool_id for trial in trials]
    names = sorted({tool for tool in tools if tool is not None})
    if len(names) >= _SEVERAL_TOOLS and None not in tools:
        return np.array([names.index(str(tool)) for tool in tools])
    count = len(trials)
    if count <= ONE_BY_ONE:
        return np.arange(count)
    shuffled = np.random.default_rng(seed).permutation(count)
    fold = np.empty(count, dtype=np.int64)
    fold[shuffled] = np.arange(count) % FOLDS
    return fold


def held_out(
    problem: Problem, lines: Lines, effects: Effects, x: ArrayLike, fold: NDArray[np.int64]
) -> HeldOut:
    """Fit again without each fold, from the unknowns `x` [U] of a fit to all trials; score those left out."""
    owner = lines.owner
    use = (fold[owner] != np.arange(fold.max() + 1)[:, None]).astype(float)
    descent = Descent(problem, effects)
    fits = descent.fits(descent.descend_folds(np.asarray(x), use, _STEPS), use)
    own = fold[owner]
    error = in_lines_n2(fits, own) + lines.rest_n2
    if grows(effects):
        error = np.maximum(error + growth_n2(problem, lines, fits, own), 0.0)
    return HeldOut(by_trial(error, owner), by_trial(lines.energy_n2, owner), fits, fold)


def in_lines_n2(fits: Fit, own: NDArray[np.int64]) -> NDArray[np.float64]:
    """[R, 3] squared error in the lines of every trial, or piece of one, N^2, without what lies between them.

    Arguments: `fits` of every fold [F]; `own` [R] fold whose model a trial is held against.
    """
    return np.asarray(fits.error_n2)[own, np.arange(len(own))]


def on_other_lines(problem: Problem, lines: Lines, effects: Effects, known: HeldOut) -> HeldOut:
    """The error of fits without each fold that are `known`, on other lines of the same trials, which are
    whole: each trial's own phase and bias are fitted again, nothing else."""
    assert known.fits is not None
    x = np.asarray(known.fits.x)
    fits = Descent(problem, effects).fits(x, np.ones((len(x), problem.trials)))
    error = in_lines_n2(fits, known.fold)
    return HeldOut(error + lines.rest_n2, lines.energy_n2, known.fits, known.fold)


def by_trial(by_piece: NDArray[np.floating], owner: NDArray[np.int64]) -> NDArray[np.floating]:
    """[R, A] sums over the pieces of every trial, of values [n, A] of each piece, `owner` [n] whose it is."""
    total = np.zeros((int(owner.max()) + 1, by_piece.shape[1]))
    np.add.at(total, owner, by_piece)
    return total
