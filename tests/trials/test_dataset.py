"""The records that hold trials: what they refuse, what they keep, and the axes mapping."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import FrozenInstanceError, replace
from itertools import permutations, product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from mjx_cutting.trials import AntiAlias, Dataset, Sensor, ToolInfo, Trial
from mjx_cutting.trials.dataset import check_axes, columns_to_process, process_to_columns

ALL_AXES = [
    tuple(sign + axis for sign, axis in zip(signs, order, strict=True))
    for order in permutations("xyz")
    for signs in product("+-", repeat=3)
]
TOOL = ToolInfo("end_mill", 2, 0.025)


def trial(**changes: object) -> Trial:
    arguments: dict[str, object] = {
        "file": "t.csv",
        "kind": "cut",
        "milling": "slot",
        "spindle_speed_rev_s": 20.0,
        "feed_speed_m_s": 0.002,
        "radial_depth_m": 0.025,
        "axial_width_m": 0.003,
        "time_s": np.arange(10) / 100,
        "force_n": np.arange(30.0).reshape(10, 3),
    }
    return Trial(**(arguments | changes))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: ToolInfo("hammer", 2, 0.025), ["tool.kind", "hammer", "end_mill"]),
        (lambda: ToolInfo("end_mill", 0, 0.025), ["tool.teeth", "0", "at least 1"]),
        (lambda: ToolInfo("end_mill", True, 0.025), ["tool.teeth", "True"]),
        (lambda: ToolInfo("end_mill", 2, -0.025), ["tool.diameter_m", "-0.025", "greater than 0"]),
        (lambda: ToolInfo("end_mill", 2, float("nan")), ["tool.diameter_m", "nan", "finite"]),
        (lambda: ToolInfo("end_mill", 2, 0.025, 45.0), ["tool.helix_rad", "45.0", "radians"]),
        (lambda: Sensor(0.0), ["sensor.sample_rate_hz", "0.0", "greater than 0"]),
        (lambda: Sensor(500.0, (0.1,)), ["sensor.noise_std_n", "three"]),  # type: ignore[arg-type]
        (
            lambda: Dataset(name="s", tool=ToolInfo("end_mill", 2, 0.01), sensor=Sensor(500.0, (0.1, 0.1))),
            ["sensor.noise_std_n", "three numbers for tool.kind 'end_mill'"],
        ),
        (lambda: Sensor(500.0, (0.1, -0.1, 0.1)), ["sensor.noise_std_n[1]", "-0.1"]),
        (lambda: Sensor(500.0, zeroed="never"), ["sensor.zeroed", "never", "session"]),  # type: ignore[arg-type]
        (lambda: Sensor(500.0, units="lbf"), ["sensor.units", "lbf", "arbitrary"]),  # type: ignore[arg-type]
        (lambda: AntiAlias(order=0), ["anti_alias.order", "0", "1 to 20"]),
        (lambda: AntiAlias(hz=-1.0), ["anti_alias.hz", "-1.0"]),
        (lambda: AntiAlias(zero_phase=1), ["anti_alias.zero_phase", "true or false"]),  # type: ignore[arg-type]
        (lambda: trial(kind="probe"), ["t.csv: kind", "probe", "air"]),
        (lambda: trial(milling="up"), ["t.csv: milling", "up", "conventional"]),
        (lambda: trial(spindle_speed_rev_s=0.0), ["t.csv: spindle_speed_rev_s", "0.0", "greater than 0"]),
        (lambda: trial(feed_speed_m_s=-0.1), ["t.csv: feed_speed_m_s", "-0.1", "not less than 0"]),
        (lambda: trial(force_n=np.zeros((9, 3))), ["t.csv: force_n", "(9, 3)", "(10, 3)", "time_s"]),
        (lambda: trial(time_s=np.zeros((10, 1))), ["t.csv: time_s", "(10, 1)", "flat"]),
        (lambda: trial(position_m=np.zeros(10)), ["position_m", "(10,)", "(10, 3)"]),
        (lambda: trial(spindle_angle_rad=np.zeros(9)), ["spindle_angle_rad", "(9,)", "(10,)"]),
    ],
)
def test_refuses_what_cannot_be(make, words):
    with pytest.raises(ValueError) as caught:
        make()
    for word in words:
        assert word in str(caught.value)


def test_arrays_are_float64_and_read_only_and_the_givers_stay_writable():
    mine = np.arange(30, dtype=np.float32).reshape(10, 3)
    also = np.arange(10) / 100
    made = trial(force_n=mine, time_s=also)
    assert made.force_n.dtype == np.float64
    for array in (made.force_n, made.time_s):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1
    mine[0, 0] = 7.0
    also[0] = 0.0
    with pytest.raises(FrozenInstanceError):
        made.file = "other.csv"  # type: ignore[misc]


def test_revolutions_and_signals():
    made = trial()
    assert made.revolutions == pytest.approx(0.09 * 20)
    assert made.signals is made.force_n
    drilled = trial(milling=None, torque_nm=np.arange(10.0))
    assert drilled.signals.shape == (10, 2)
    np.testing.assert_array_equal(drilled.signals[:, 0], drilled.force_n[:, 2])


def test_a_dataset_refuses_one_file_twice():
    with pytest.raises(ValueError, match=r"t\.csv twice"):
        Dataset(name="d", tool=TOOL, sensor=Sensor(100.0), trials=(trial(), trial()))
    Dataset(name="d", tool=TOOL, sensor=Sensor(100.0), trials=(trial(), replace(trial(), file="u.csv")))


@given(
    axes=st.sampled_from(ALL_AXES),
    force=hnp.arrays(np.float64, (5, 3), elements=st.floats(-1e6, 1e6, allow_subnormal=False)),
)
def test_axes_map_is_a_signed_permutation_that_inverts_exactly(axes, force):
    process = columns_to_process(force, axes)
    np.testing.assert_array_equal(process_to_columns(process, axes), force)
    np.testing.assert_array_equal(columns_to_process(process_to_columns(force, axes), axes), force)
    matrix = np.zeros((3, 3))
    for column, (sign, axis) in enumerate(axes):
        matrix["xyz".index(axis), column] = 1.0 if sign == "+" else -1.0
    np.testing.assert_array_equal(process, force @ matrix.T)
    np.testing.assert_array_equal(np.sort(np.abs(process), axis=1), np.sort(np.abs(force), axis=1))


def test_axes_examples():
    columns = np.array([[1.0, 2.0, 3.0]])
    assert columns_to_process(columns, None) is columns
    np.testing.assert_array_equal(columns_to_process(columns, ("+x", "+y", "+z")), columns)
    np.testing.assert_array_equal(columns_to_process(columns, ("+y", "+x", "-z")), [[2.0, 1.0, -3.0]])
    # Column 0 measures -z, column 1 +x, column 2 +y.
    np.testing.assert_array_equal(columns_to_process(columns, ("-z", "+x", "+y")), [[2.0, 3.0, -1.0]])


@pytest.mark.parametrize(
    "axes", [["+x", "+y"], ["+x", "+x", "+z"], ["x", "y", "z"], "xyz", ["+x", "-x", "+y"], [1, 2, 3]]
)
def test_axes_that_are_none_are_refused(axes):
    with pytest.raises(ValueError, match="axes: got"):
        check_axes(axes)


def test_importing_the_room_and_reading_load_no_jax(folder):
    path = folder.write()
    code = (
        "import sys, mjx_cutting.trials as t\n"
        "assert not {'jax', 'pyarrow', 'pooch', 'scipy'} & set(sys.modules), 'the room itself must be "
        "light'\n"
        f"t.read({str(path)!r})\n"
        "import mjx_cutting.trials.commands, mjx_cutting.trials.importers.mcap\n"
        "assert 'jax' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_unknown_name_of_the_room():
    import mjx_cutting.trials as room

    assert set(room.__all__) <= set(dir(room))
    with pytest.raises(AttributeError, match="no attribute 'rad'"):
        _ = room.rad
