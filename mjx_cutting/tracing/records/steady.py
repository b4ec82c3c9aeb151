"""Where in a record a drill or a turning tool is in full engagement.

Such a tool comes in over its point or its lead angle, the force with it, on a ramp that at a low feed may be
longer than all that follows; then it bends into a level. That bend is where two straight lines that meet
leave least; where it goes out over a ramp as well, both bends are looked for at once, with a level between
them. Where there is none, ends at which the tool comes in or goes out are trimmed by a tenth of the cut.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

IN_CUT = 0.5
"""Share of the usual force above which the tool is in the cut."""

_TRIMMED = 0.1
_AT_LEVEL = 0.9
_FEWEST = 8
_BINS = 100
_FEWER_BINS = 50
_SHORTEST = 0.1
_RISE = 0.2
_FLAT = 0.05
_CLOSE = 0.02
_SWINGS = 6.0
_FROM_HALF = 0.35
Array = NDArray[np.floating]


def steady(force: Array) -> slice:
    """Samples in full engagement of a record [T, 3]: all, where it shows too few in the cut to tell."""
    size, first, last = _in_the_cut(force)
    if last == 0:
        return slice(None)
    if (bends := _between_ramps(size[first:last])) is not None:
        up, down = bends
        inward = int(_SHORTEST * (down - up))
        return slice(first + up + inward, first + down - inward)
    trim = int(_TRIMMED * (last - first))
    ramp, end = _ramp(size[first : last - trim]), _ramp(size[first + trim : last][::-1])
    comes_in = first > 0 or _rises(size[first : first + trim])
    goes_out = last < len(size) or _rises(size[last - trim : last][::-1])
    begin, stop = first + (ramp or trim * comes_in), last - (end or trim * goes_out)
    return slice(begin, stop) if stop - begin >= _FEWEST else slice(first, last)


def bend_in(force: Array, wavy: bool = False) -> int | None:
    """Sample of a record [T, 3] at which it bends from a ramp into its level; None where it shows no bend. If
    `wavy`, the level may swing, as over a sheet that is not even, and the bend is only about there."""
    size, first, last = _in_the_cut(force)
    if last == 0:
        return None
    if (bends := _between_ramps(size[first:last])) is not None:
        return first + bends[0]
    stretch = size[first : last - int(_TRIMMED * (last - first))]
    bend, each = _bend(stretch, _SWINGS, _FROM_HALF) if wavy else _bend(stretch)
    return first + bend * each if bend else None


def _in_the_cut(force: Array) -> tuple[Array, int, int]:
    """[T] size of the force, the first sample in the cut and the one after the last; 0 and 0 where too few
    are to tell."""
    size, usual = sizes(force)
    inside = np.flatnonzero(size > IN_CUT * usual)
    return (size, 0, 0) if len(inside) < _FEWEST else (size, int(inside[0]), int(inside[-1]) + 1)


def sizes(force: Array) -> tuple[Array, float]:
    """[T] size of the force, each channel by its largest, and what is usual in the cut."""
    size = np.linalg.norm(force / np.maximum(np.abs(force).max(axis=0), 1e-12), axis=1)
    return size, float(np.median(size[size >= 0.2 * size.max()]))


def _ramp(size: Array) -> int:
    """Samples of a stretch [T] on which it rises before it bends into a level; 0 where it does not."""
    bend, each = _bend(size)
    # a ramp need not be quite straight, and the bend is somewhere within a bin
    return (bend + int(_SHORTEST * (_BINS - bend))) * each if bend else 0


def _bend(size: Array, times: float = 1.0, least_rise: float = _RISE) -> tuple[int, int]:
    """Bins of a stretch [T] before it bends from a ramp into a level, 0 where it does not, and samples of
    each. The level may be as many `times` as uneven as one of an even sheet; of it the ramp rises by
    `least_rise` or more."""
    each = len(size) // _BINS
    if each == 0:
        return 0, 0
    level = size[: each * _BINS].reshape(_BINS, each).mean(axis=1)
    place = np.arange(_BINS) + 0.5
    best, least = np.zeros(3), np.inf
    bend = 0
    for at in range(int(_SHORTEST * _BINS), int((1.0 - _SHORTEST) * _BINS) + 1):
        lines = np.stack([np.ones(_BINS), np.minimum(place - at, 0.0), np.maximum(place - at, 0.0)], axis=1)
        fit, *_ = np.linalg.lstsq(lines, level, rcond=None)
        left = float(np.sum((level - lines @ fit) ** 2))
        if left < least:
            best, least, bend = fit, left, at
    reached, rise, after = best
    slope, uneven = abs(after) * (_BINS - bend), float(np.sqrt(least / _BINS))
    flat = slope < times * _FLAT * reached and uneven < times * _CLOSE * reached
    return (0 if not flat or rise * bend < least_rise * reached else bend), each


def _between_ramps(size: Array) -> tuple[int, int] | None:
    """Samples at which a stretch [T] bends into its level after a ramp up, and out of it before one down;
    None where it is not of the kind, or hardly a tenth of it is level."""
    each = len(size) // _FEWER_BINS
    if each == 0:
        return None
    level = size[: each * _FEWER_BINS].reshape(_FEWER_BINS, each).mean(axis=1)
    place = np.arange(_FEWER_BINS) + 0.5
    shortest = int(_SHORTEST * _FEWER_BINS)
    bends = [
        (up, down) for up in range(1, _FEWER_BINS - shortest) for down in range(up + shortest, _FEWER_BINS)
    ]
    up, down = (np.asarray(bend)[:, None] for bend in zip(*bends, strict=True))
    ramps = np.minimum(place - up, 0.0), np.minimum(down - place, 0.0)
    lines = np.stack([np.ones_like(ramps[0]), *ramps], axis=-1)
    square = np.einsum("ptk,ptl->pkl", lines, lines)
    fits = np.linalg.solve(square, (lines.swapaxes(1, 2) @ level)[..., None])[..., 0]
    left = np.sum((level - np.einsum("ptk,pk->pt", lines, fits)) ** 2, axis=1)
    best = int(np.argmin(left))
    reached, rise, fall = fits[best]
    first, last = bends[best]
    long = min(rise * first, fall * (_FEWER_BINS - last)) >= _RISE * reached
    if not long or np.sqrt(left[best] / _FEWER_BINS) > _CLOSE * reached:
        return None
    return first * each, last * each


def _rises(size: Array) -> bool:
    """Whether the force is less at the beginning of a stretch [T] than in the rest of it."""
    early, rest = np.split(size, [len(size) // 4])
    return bool(len(early) == 0 or early.mean() < _AT_LEVEL * rest.mean())
