"""A measured way forth and back: its legs, beside the noise it was measured with."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_coeffs, savgol_filter

_TURNS_BACK = 0.005
_OVER_NOISE = 6.0
_WIDTHS = (7, 13, 25, 49, 97)
_CUBIC = 3
_ONLY_NOISE = 4.0
Array = NDArray[np.floating]


class Legs(NamedTuple):
    """Stretches of a way between its turns.

    Fields:
        forth: [L] which way each goes, 1.0 forth or -1.0 back; whole_m: [L] how far, m.
        leg: [T] of each sample; gone_m: [T] how far on its leg it has come, m.
        span_m: from its one end to the other, m.
    """

    forth: Array
    whole_m: Array
    leg: NDArray[np.int_]
    gone_m: Array
    span_m: float


def legs_of(way_m: Array) -> Legs:
    """The legs of a way [T], m, between those turns after which it goes back by more than a share of it all,
    and than the noise it was measured with."""
    forth, leg, gone_m = [], np.zeros(len(way_m), int), np.zeros(len(way_m))
    for index, (part, each) in enumerate(_between_turns(way_m)):
        forth.append(each)
        leg[part] = index
        gone_m[part] = np.maximum.accumulate(each * (way_m[part] - way_m[part.start]))
    last = np.append(np.flatnonzero(np.diff(leg)), len(leg) - 1)
    return Legs(np.array(forth), gone_m[last], leg, gone_m, float(np.ptp(way_m)))


def _between_turns(way_m: Array) -> list[tuple[slice, float]]:
    found: list[tuple[slice, float]] = []
    first = 0
    band = max(_TURNS_BACK * float(np.ptp(way_m)), _OVER_NOISE * white_noise(way_m))
    gone = way_m - way_m[0]
    far = np.flatnonzero(np.abs(gone) > band)
    forth = 1.0 if not len(far) or gone[far[0]] > 0.0 else -1.0
    while True:
        along = forth * way_m[first:]
        back = np.flatnonzero(np.maximum.accumulate(along) - along > band)
        if not len(back):
            return [*found, (slice(first, len(way_m)), forth)]
        turn = first + int(np.argmax(along[: back[0] + 1]))
        found.append((slice(first, turn), forth))
        first, forth = turn, -forth


def white_noise(value: Array) -> float:
    """Standard deviation of the white noise in what is else smooth [T], by its fourth differences."""
    return float(np.std(np.diff(value, n=4))) / np.sqrt(70.0) if len(value) > 4 else 0.0


def smoothed(place_m: Array) -> Array:
    """A place [T] smoothed as far as that takes no more than white noise from it."""
    noise, found = white_noise(place_m), place_m
    for width in (each for each in _WIDTHS if each <= len(place_m)):
        smooth = savgol_filter(place_m, width, _CUBIC)
        taken = noise * np.sqrt(1.0 - savgol_coeffs(width, _CUBIC)[width // 2])
        if np.std(place_m - smooth) > (1.0 + _ONLY_NOISE / np.sqrt(len(place_m))) * taken:
            break
        found = smooth
    return found
