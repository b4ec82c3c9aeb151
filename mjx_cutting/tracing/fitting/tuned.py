"""Angle of a trial whose lines move along its path: where in the turn it began, and how fast it turned.

Lines of a whole record tell both where they stay put. Where the response changes on the way (a rim that goes
into the sheet, a mode that moves along it), the spindle's lines are smeared, and a speed read from them may
be off by some parts in a thousand: enough to lose step within one record. So both are found again beneath the
moving lines: speeds about the one read are held against the record, each at its best phase, and the best is
refined by Gauss and Newton's steps.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mjx_cutting.tracing.fitting.moving import MovingLines

_LIMIT = 0.01
_STEP_RAD = 0.4
_PHASES = 1024
_STEPS = 6
_DIFFERENCE = 1e-5
_MOST_SPEEDS = 201
Array = NDArray[np.floating]


def tuned_angle(
    moving: MovingLines, angle_rad: Array, known: bool, teeth: int, measured_n: Array, weight: Array
) -> Array:
    """[T] angle of tooth 0 under which moving lines meet a record best, within 1 % of the speed.

    Arguments:
        moving: the lines.
        angle_rad: [T] as known so far.
        known: whether the angle was measured, so that only where the tool began is unknown.
        teeth: of the tool.
        measured_n: [T, 3] the record, N; its mean is not looked at.
        weight: [3] of each axis, 1/N.
    """
    span = float(np.ptp(angle_rad))
    way = (angle_rad - angle_rad[0]) / span - 0.5
    reach = 0.0 if known else _LIMIT * span
    count = 1 + 2 * min(_MOST_SPEEDS // 2, int(np.ceil(0.5 * reach * teeth / _STEP_RAD)))
    record = _without_mean(measured_n) * weight**2
    best, angle = -np.inf, angle_rad
    for away in np.linspace(-reach, reach, count):
        here = angle_rad + away * way
        likeness = np.fft.irfft(moving.likeness(here, record), _PHASES)
        at = int(np.argmax(likeness))
        if likeness[at] > best:
            best, angle = float(likeness[at]), here + 2.0 * np.pi * at / _PHASES
    return refined_angle(moving, angle, known, measured_n, weight)


def refined_angle(
    moving: MovingLines, angle_rad: Array, known: bool, measured_n: Array, weight: Array
) -> Array:
    """[T] an angle that is nearly right, moved and unless `known` stretched to where less is left; the rest
    as of `tuned_angle`."""
    way = None if known else (angle_rad - angle_rad[0]) / float(np.ptp(angle_rad)) - 0.5
    angle, force = angle_rad, moving.force(angle_rad)
    left = _without_mean(measured_n - force) * weight
    for _ in range(_STEPS):
        slope = (_without_mean(moving.force(angle + _DIFFERENCE) - force) * weight) / _DIFFERENCE
        columns = [slope] if way is None else [slope, slope * way[:, None]]
        matrix = np.stack([each.ravel() for each in columns], axis=1)
        step = np.linalg.lstsq(matrix, left.ravel(), rcond=None)[0]
        closer = angle + step[0] + (0.0 if way is None else step[1] * way)
        force = moving.force(closer)
        after = _without_mean(measured_n - force) * weight
        if float(np.sum(after**2)) >= float(np.sum(left**2)):
            break
        angle, left = closer, after
    return angle


def _without_mean(record: Array) -> Array:
    return record - record.mean(axis=0)
