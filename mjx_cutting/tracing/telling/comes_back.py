"""What a model leaves that comes back at a rate of its own, told with what does so."""

from __future__ import annotations

from collections.abc import Sequence

from mjx_cutting.tracing.along.own_rate import own_rate
from mjx_cutting.tracing.fitting.prediction import Prediction
from mjx_cutting.trials.dataset import Dataset

_OF = {
    "turn": "something that turns with the spindle at a rate of its own: a bearing, a gear, a belt",
    "second": "something that runs by itself, whatever the spindle does: a pump, a fan, another machine",
    "metre": "something along the path: a pattern of the sheet, a screw or rail of the feed",
}


def comes_back(dataset: Dataset, predicted: Sequence[Prediction]) -> str | None:
    """In words, what comes back and how often; None where nothing does.

    Arguments: the trials, and what a model predicts of them, by the same files.
    """
    found = own_rate(dataset, predicted)
    if found is None:
        return None
    shown = [(each.file, low) for each, low in zip(predicted, found.lowest_hz, strict=True) if low]
    (first, low), *_ = shown
    what = ", or ".join(_OF[per] for per in found.rates)
    return (
        f"in {len(shown)} of {len(predicted)} trials what is left comes back {found}, with "
        f"{found.multiples} multiples heard ({first} at {low:.1f} Hz): {what}"
    )
