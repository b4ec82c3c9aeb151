"""Process damping where the records have the tool's vibration: a measured place across the path.

The flank rubs on the wave that the edge leaves as it moves into the sheet at v, and presses back by C b v /
v_c, v_c the cutting speed: each tooth in the cut, or the tool as one. With v from the record that is one
column, the force at 1 N/m and 1 m/s times it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from mjx_cutting.cutting import AbstractEffect, effect_class
from mjx_cutting.tracing.along.flutes import of_a_drill
from mjx_cutting.tracing.along.kind import Kind, listed
from mjx_cutting.tracing.records.course import Course

NAME = "process_damping"
Array = NDArray[np.floating]


def plunge_m_s(course: Course) -> Array:
    """[T] speed at which the tool moves into the sheet, m/s; nil where it was not measured."""
    if course.beside_m is None:
        return np.zeros(len(course.time_s))
    return np.asarray(CubicSpline(course.time_s, course.beside_m)(course.time_s, 1))


def _shows(courses: Sequence[Course]) -> bool:
    """Whether the motion across the path was measured; the radial forces of a drill's lips cancel."""
    return not of_a_drill(courses) and any(each.beside_m is not None for each in courses)


def _columns(course: Course, shape: Array) -> Array:
    """[T, 3, 1] force of process damping of 1 N/m, N."""
    assert course.damped_n is not None
    return (course.damped_n()[..., int(shape[0])] * plunge_m_s(course)[:, None])[..., None]


def _ways(courses: Sequence[Course]) -> Array:
    """[2, 1] of each tooth in the cut, and of the tool as one."""
    return np.array([[0.0], [1.0]])


def _effect(shape: Array, c: Array) -> AbstractEffect:
    return effect_class(NAME)(damping_n_m=float(c[0]), of_tool=float(shape[0]))


def _parts(effect: AbstractEffect) -> tuple[Array, Array]:
    return listed(effect, "of_tool"), listed(effect, "damping_n_m")


DAMPED = Kind(NAME, _shows, _ways, _columns, _effect, _parts)
"""How process damping is looked for along a trial."""
