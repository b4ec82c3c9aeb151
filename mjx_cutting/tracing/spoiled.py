"""One trial unlike all others: a cable that came loose, a sensor that saturated, a record begun too late.

Where what is known does not explain all that is missing, and either the model fitted without one trial leaves
half as much of the others, beside noise, as one fitted without any other does, or most of what is left is
missing in one, the others are traced without it. Only if that settles the matter, or at least halves what is
left beside noise, is the trial left out, by name and with its figures. A trial unlike the others spoils the
fit of all; but few levels are fitted well without any of them, so there what each leaves by itself counts,
and among many the one without which an effect that was tried leaves next to nothing of the others. And a
trial of which the conditions, places or times are not what is said leaves no more than the others do, but
what explains much of each of them makes it worse: that, too, is tried.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.tracing.records.levels import LEVEL_KINDS
from mjx_cutting.trials.dataset import Dataset, LeftOut

_FEWEST = 5
_MANY = 7
_HALF = 0.5
_MOST_OF_IT = 0.7
_TIMES_THE_OTHERS = 3.0
_NEXT_TO_NOTHING = 2.0
_EXPLAINS = 0.25


def spoiled(
    dataset: Dataset,
    left: HeldOut,
    tried: Sequence[tuple[HeldOut, HeldOut]] = (),
    floor_nrmse: float = 0.0,
) -> LeftOut | None:
    """The trial that is unlike the others, and why; None where there is no such.

    Arguments:
        dataset: the trials; `left` the error on held-out cut trials, in their order.
        tried: the same without and with each effect that was tried last, the best first.
        floor_nrmse: share of the force that noise is, which is missing nowhere.
    """
    files = [trial.file for trial in dataset.trials if trial.kind == "cut"]
    error, share = beyond_noise(left, floor_nrmse)
    if not _FEWEST <= len(error) == len(files):
        return None
    beside = None if dataset.tool.kind in LEVEL_KINDS else _of_the_others(left, floor_nrmse)
    if beside is not None:
        least, second = np.sort(beside)[:2]
        worst = int(np.argmin(beside))
        if least < _HALF * second and share[worst] > floor_nrmse:
            return _unlike(files[worst], share[worst], least)
    elif (alone := _alone_against(files, [after for _, after in tried], floor_nrmse)) is not None:
        return _unlike(files[alone], share[alone], floor_nrmse)
    worst = int(np.argmax(error))
    usual = float(np.median(np.delete(share, worst)))
    unlike = error[worst] >= _MOST_OF_IT * error.sum() and share[worst] >= _TIMES_THE_OTHERS * usual
    if not unlike or share[worst] <= floor_nrmse:
        return next((one for each in tried if (one := _opposed(files, *each)) is not None), None)
    return _unlike(files[worst], share[worst], usual)


def beyond_noise(left: HeldOut, floor_nrmse: float) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """[R] squared error of each trial beyond noise, which is `floor_nrmse` of the force, N^2, and [R] the
    share of its force that is."""
    energy = left.energy_n2.sum(axis=1)
    error = np.maximum(left.error_n2.sum(axis=1) - floor_nrmse**2 * energy, 0.0)
    return error, np.sqrt(error / np.maximum(energy, 1e-300))


def _alone_against(files: Sequence[str], tried: Sequence[HeldOut], floor_nrmse: float) -> int | None:
    """The one level, of many, without which a model leaves of the others about the noise, and without any
    other many times as much."""
    for after in tried:
        beside = _of_the_others(after, floor_nrmse) if len(after.fold) == len(files) >= _MANY else None
        if beside is not None:
            least, second = np.sort(beside)[:2]
            if least < min(_NEXT_TO_NOTHING * floor_nrmse, second / _TIMES_THE_OTHERS):
                return int(np.argmin(beside))
    return None


def _opposed(files: Sequence[str], left: HeldOut, after: HeldOut) -> LeftOut | None:
    """The one trial, of more than the fewest, that is predicted worse by what explains much in each other."""
    if not len(left.error_n2) == len(after.error_n2) == len(files):
        return None
    explained = 1.0 - after.error_n2.sum(axis=1) / np.maximum(left.error_n2.sum(axis=1), 1e-300)
    worst = int(np.argmin(explained))
    others = np.delete(explained, worst)
    if len(others) < _FEWEST or explained[worst] >= 0.0 or others.min() < _EXPLAINS:
        return None
    return LeftOut(
        files[worst],
        f"got a trial that is predicted worse, by {-explained[worst]:.0%} of its squared error, with what "
        f"explains {others.min():.0%} or more of that of each other, expected the same force under the same "
        "conditions: look at those declared of it, and where on the path its record begins.",
    )


def _unlike(file: str, share: float, usual: float) -> LeftOut:
    return LeftOut(
        file,
        f"got a trial of which {share:.0%} of the force is left unexplained, expected about the {usual:.1%} "
        "of the others; look at its record, and cut it again.",
    )


def _of_the_others(left: HeldOut, floor_nrmse: float) -> NDArray[np.floating] | None:
    """[R] share of the force of all other trials that the fit without one leaves of them beside noise; None
    where trials were not left out one by one, or pieces of them were fitted."""
    count = len(left.fold)
    if left.fits is None or not np.array_equal(left.fold, np.arange(count)):
        return None
    in_lines = np.asarray(left.fits.error_n2).sum(axis=-1)
    if in_lines.shape != (count, count):
        return None
    error = in_lines + np.maximum(left.error_n2.sum(axis=1) - np.diag(in_lines), 0.0)
    others = 1.0 - np.eye(count)
    squared = (others * error).sum(axis=1) / (others @ left.energy_n2.sum(axis=1))
    return np.sqrt(np.maximum(squared - floor_nrmse**2, 0.0))


def without(dataset: Dataset, trial: LeftOut) -> Dataset:
    """The trials without one, which is named among those left out."""
    rest = tuple(each for each in dataset.trials if each.file != trial.file)
    return replace(dataset, trials=rest, left_out=(*dataset.left_out, trial))
