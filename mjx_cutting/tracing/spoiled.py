"""One trial unlike all others: a cable that came loose, a sensor that saturated, the wrong sheet.

Where what is known does not explain all that is missing, and nearly all that is left is missing in one trial,
the others are traced without it. Only if that settles the matter, or at least halves what is left, is the
trial left out, by name and with its figures.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.trials.dataset import Dataset, LeftOut

_FEWEST = 5
_MOST_OF_IT = 0.7
_TIMES_THE_OTHERS = 3.0


def spoiled(dataset: Dataset, left: HeldOut) -> LeftOut | None:
    """The trial that is unlike the others, and why; None where there is no such.

    Arguments:
        dataset: the trials; `left` the error on held-out cut trials, in their order.
    """
    files = [trial.file for trial in dataset.trials if trial.kind == "cut"]
    error, share = left.error_n2.sum(axis=1), left.per_trial
    if not _FEWEST <= len(error) == len(files):
        return None
    worst = int(np.argmax(error))
    usual = float(np.median(np.delete(share, worst)))
    if error[worst] < _MOST_OF_IT * error.sum() or share[worst] < _TIMES_THE_OTHERS * usual:
        return None
    return LeftOut(
        files[worst],
        f"got a trial of which {share[worst]:.0%} of the force is left unexplained, expected about the "
        f"{usual:.1%} of the others; look at its record, and cut it again.",
    )


def without(dataset: Dataset, trial: LeftOut) -> Dataset:
    """The trials without one, which is named among those left out."""
    rest = tuple(each for each in dataset.trials if each.file != trial.file)
    return replace(dataset, trials=rest, left_out=(*dataset.left_out, trial))
