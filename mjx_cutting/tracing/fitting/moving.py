"""The force of a trial whose lines move along its path, from lines at even steps of the way."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.tracing.records.lines import Lines, band_limit, heard_turns

Array = NDArray[np.floating]


def wave(lines: Lines, trial: int, angle_rad: Array, coefficients: NDArray, rate_hz: float) -> Array:
    """[T, 3] force of given lines [orders + 1, 3] at the tool angles [T] of a trial, within the band, N."""
    return band_limit(np.real(heard_turns(lines, trial, angle_rad) @ coefficients), rate_hz, lines.band_hz)


class MovingLines:
    """Lines of one trial [K, orders + 1, A], of A axes, at even steps of the way, straight between them."""

    def __init__(self, lines: Lines, trial: int, places: NDArray, place_m: Array, rate_hz: float):
        """`trial` is the place in `lines`; `place_m` [T] the way, m."""
        self.lines, self.trial, self.places, self.rate_hz = lines, trial, places, rate_hz
        way = (place_m - place_m.min()) / max(float(np.ptp(place_m)), 1e-12) * (len(places) - 1)
        knot = np.minimum(way.astype(int), len(places) - 2)
        self.after = (way - knot)[:, None]
        self.stretches = _stretches(knot)

    def force(self, angle_rad: Array) -> Array:
        """[T, A] force at the tool angles [T], within the band, N."""
        turned = heard_turns(self.lines, self.trial, angle_rad)
        force = np.empty((len(turned), self.places.shape[-1]))
        for knot, here in self.stretches:
            near, next_ = (np.real(turned[here] @ self.places[each]) for each in (knot, knot + 1))
            force[here] = near + self.after[here] * (next_ - near)
        return band_limit(force, self.rate_hz, self.lines.band_hz)

    def likeness(self, angle_rad: Array, measured_n: Array) -> NDArray[np.complexfloating]:
        """[orders + 1] S_n, of which sum over n of Re(S_n exp(i n p)) is the product of a record [T, 3] with
        the force at the angles [T] turned by p, but for a factor."""
        turned = heard_turns(self.lines, self.trial, angle_rad).T
        total = np.zeros(len(turned), dtype=complex)
        for knot, here in self.stretches:
            after = self.after[here]
            for each, share in ((knot, 1.0 - after), (knot + 1, after)):
                total += np.sum((turned[:, here] @ (share * measured_n[here])) * self.places[each], axis=1)
        return total


def _stretches(knot: NDArray[np.int_]) -> list[tuple[int, slice | NDArray[np.bool_]]]:
    """Every knot with the samples between it and the next, from the knot before each sample [T]."""
    knots, first = np.unique(knot, return_index=True)
    if np.all(np.diff(knot) >= 0):
        last = [*first[1:], len(knot)]
        return [(int(k), slice(begin, end)) for k, begin, end in zip(knots, first, last, strict=True)]
    return [(int(k), knot == k) for k in knots]
