"""A recording survives being killed anywhere; what is merged is what was measured, on an even grid."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mjx_cutting.trials import parts, read

SESSION: dict[str, Any] = {
    "name": "recorded",
    "tool": {"kind": "slitting_saw", "teeth": 20, "diameter_m": 0.05},
    "sensor": {"sample_rate_hz": 500.0, "zeroed": "session"},
    "trial": {
        "milling": "conventional", "material": "mica", "axial_width_m": 0.0016, "spindle_speed_rev_s": 19.0,
    },
}  # fmt: skip


def samples(count: int, *, touch: int | None = None, start_ns: int = 10**12, flags: int = 16) -> np.ndarray:
    """`count` samples at 500 Hz; the cut begins at sample `touch`."""
    s = np.zeros(count, parts.SAMPLE)
    s["time_ns"] = start_ns + np.arange(count) * 2_000_000
    s["flags"] = flags
    draw = np.random.default_rng(0)
    for name in ("force_x_n", "force_y_n", "force_z_n"):
        s[name] = draw.normal(0, 1, count)
    s["position_y_m"] = 0.3 - 0.0125 * np.arange(count) / 500
    s["feed_speed_m_s"], s["depth_m"], s["spindle_speed_rev_s"] = 0.0125, 0.001, 19.0
    if touch is not None:
        s["cut_length_m"] = np.maximum(0, np.arange(count) - touch) * 0.0125 / 500
    return s


def fill(folder: Path, given: np.ndarray) -> parts.Parts:
    recording = parts.Parts(folder, SESSION)
    recording.begin()
    for second in np.split(given, np.arange(500, len(given), 500)):
        recording.add(second)
    return recording


def test_air_and_cut_are_parted_and_what_is_read_is_what_was_measured(tmp_path: Path) -> None:
    given = samples(3000, touch=1000)
    told = fill(tmp_path / "d", given).close()
    dataset = read(tmp_path / "d")
    air, cut = dataset.trials
    assert (air.kind, cut.kind) == ("air", "cut") and len(told) == 2
    assert air.samples == 1001 and cut.samples == 3000 - 1000 - 2 * 250 - 2
    kept = given[1251:2749]
    base = np.stack([kept[f"force_{axis}_n"] for axis in "xyz"], axis=-1)
    np.testing.assert_allclose(cut.force_n, np.stack([-base[:, 1], -base[:, 2], base[:, 0]], axis=-1))
    assert cut.radial_depth_m == pytest.approx(0.001) and cut.feed_speed_m_s == pytest.approx(0.0125)
    assert cut.cut_length_before_m == pytest.approx(kept["cut_length_m"][0])
    assert cut.material == "mica" and cut.spindle_angle_rad is None
    np.testing.assert_allclose(cut.spindle_speed_measured_rev_s, 19.0)
    assert cut.clock_start_s - air.clock_start_s == pytest.approx(1251 / 500)
    assert not (tmp_path / "d" / parts.RECORDING).exists()


def test_lost_samples_are_bridged_and_a_gap_ends_the_trial(tmp_path: Path) -> None:
    given = samples(3000)
    lost = np.zeros(3000, bool)
    lost[np.arange(7, 1400, 10)] = True  # one in ten
    lost[1500:1530] = True  # 60 ms
    told = fill(tmp_path / "d", given[~lost]).close()
    first, second = read(tmp_path / "d").trials
    assert (first.samples, second.samples) == (1500, 1470)
    assert "140 of them interpolated" in told[0] and "0 of them" in told[1]
    x = first.force_n[:, 2]  # base x is process z
    np.testing.assert_allclose(x[8:17], given["force_x_n"][8:17])
    np.testing.assert_allclose(x[7], (given["force_x_n"][6] + given["force_x_n"][8]) / 2)


def test_the_angle_is_unwrapped_and_only_kept_where_measured(tmp_path: Path) -> None:
    given = samples(1000, flags=8)
    given["spindle_angle_rad"] = (2 * np.pi * 19.0 * np.arange(1000) / 500) % (2 * np.pi)
    fill(tmp_path / "d", given).close()
    (trial,) = read(tmp_path / "d").trials
    assert trial.spindle_angle_rad is not None and trial.spindle_speed_measured_rev_s is None
    np.testing.assert_allclose(trial.spindle_angle_rad, 2 * np.pi * 19.0 * trial.time_s, atol=1e-9)


def test_killed_while_recording_all_but_the_part_in_hand_is_read(tmp_path: Path) -> None:
    folder = tmp_path / "d"
    earlier = fill(folder, samples(1000))
    earlier.end()
    earlier.begin()
    for second in np.split(samples(2500, start_ns=2 * 10**12), 5):
        earlier.add(second)
    (folder / parts.RECORDING / "0002" / ".000005.parquet").write_bytes(b"PAR1 half a part")
    (folder / parts.RECORDING / "0002" / "000006.parquet").write_bytes(b"PAR1 cut off by a power failure")
    assert len(read(folder).trials) == 1  # the recorder lives: its trial is its own
    parts.os.close(earlier._lock)  # type: ignore[arg-type, attr-defined]  # what the kernel does when it is killed
    trials = read(folder).trials
    assert [trial.samples for trial in trials] == [1000, 2500]
    assert not (folder / parts.RECORDING).exists()
    assert [trial.samples for trial in read(folder).trials] == [1000, 2500]


@pytest.mark.parametrize("stage", ["before dataset.json", "before the parts go"])
def test_killed_while_merging_nothing_is_lost_or_doubled(
    tmp_path: Path, stage: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "d"
    recording = fill(folder, samples(1500))
    with monkeypatch.context() as patch:
        target = (parts, "_list") if stage == "before dataset.json" else (shutil, "rmtree")

        def killed(*_: object) -> None:
            raise KeyboardInterrupt

        patch.setattr(*target, killed)
        with pytest.raises(KeyboardInterrupt):
            recording.end()
    parts.os.close(recording._lock)  # type: ignore[arg-type, attr-defined]
    (trial,) = read(folder).trials
    assert trial.samples == 1500


def test_a_second_recorder_is_refused_and_a_later_session_adds(tmp_path: Path) -> None:
    folder = tmp_path / "d"
    first = fill(folder, samples(1000))
    with pytest.raises(ValueError, match="being recorded"):
        parts.Parts(folder, SESSION)
    first.close()
    fill(folder, samples(1200)).close()
    assert [trial.samples for trial in read(folder).trials] == [1000, 1200]
    other = json.loads(json.dumps(SESSION))
    other["tool"]["teeth"] = 30
    with pytest.raises(ValueError, match="another folder"):
        parts.Parts(folder, other)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"tool": {"kind": "saw"}}, "tool"),
        ({"trial": {"milling": "conventional"}}, "spindle_speed_rev_s"),
        ({"trial": None}, "session.trial"),
        ({"margin_s": -1}, "margin_s"),
        ({"teeth": 20}, "teeth"),
    ],
)
def test_a_session_that_is_wrong_is_said_before_anything_is_recorded(
    tmp_path: Path, change: dict[str, Any], told: str
) -> None:
    with pytest.raises(ValueError, match=told):
        parts.Parts(tmp_path / "d", {**SESSION, **change})
    assert not (tmp_path / "d").exists()


def test_the_documented_session_is_one(repository: Path) -> None:
    text = (repository / "docs" / "serving.md").read_text()
    (block,) = re.findall(r"```json\n(.*?)```", text, re.DOTALL)
    session = parts.check_session(json.loads(block))
    assert session["axes"] == list(parts.BASE_AXES)
