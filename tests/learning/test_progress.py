import json

import numpy as np
import pytest

from mjx_cutting.learning import progress


def test_lines_hold_steps_time_and_metrics(tmp_path):
    with progress.Reporter(tmp_path, "expert", iterations=3, quiet=True) as reporter:
        reporter.report(1, 100, 100, {"loss": np.float32(0.5), "episode_return": np.asarray([1.0, 2.0])})
        reporter.report(2, 200, 100, {"loss": np.float32(np.nan)})
    one, two = progress.read_lines(tmp_path / progress.METRICS)
    assert (one["iteration"], one["steps"], one["loss"]) == (1, 100, 0.5)
    assert one["episode_return"] == [1.0, 2.0]  # one entry a seed
    assert two["loss"] is None  # JSON has no NaN
    assert two["wall_s"] >= one["wall_s"] >= 0
    assert one["steps_per_s"] > 0


def test_bar_shows_reward_and_speed(tmp_path, capsys):
    with progress.Reporter(tmp_path, "expert", iterations=2) as reporter:
        reporter.report(1, 100, 100, {"episode_return": np.asarray(-0.25)})
        reporter.report(2, 200, 100, {"episode_return": np.asarray(-0.125)})
    shown = capsys.readouterr().err
    assert "expert" in shown
    assert "-0.125" in shown
    assert "steps/s" in shown
    assert "2/2" in shown


def test_rewind_drops_what_a_resumed_run_writes_again(tmp_path):
    path = tmp_path / progress.METRICS
    lines = [json.dumps({"iteration": i, "wall_s": float(i)}) for i in range(1, 6)]
    path.write_text("\n".join(lines) + '\n{"iteration": 6, "wal')
    progress.rewind(tmp_path, 3)
    assert [line["iteration"] for line in progress.read_lines(path)] == [1, 2, 3]
    # the clock of a resumed run goes on
    with progress.Reporter(tmp_path, "expert", iterations=5, done=3, quiet=True) as reporter:
        reporter.report(4, 4, 1, {})
    assert progress.read_lines(path)[-1]["wall_s"] >= 3.0
    progress.rewind(tmp_path / "nowhere", 3)  # nothing to drop


def test_tensorboard_scalars_are_written_where_asked_for(tmp_path, monkeypatch):
    written = []

    class Writer:
        def __init__(self, folder):
            self.folder = folder

        def add_scalar(self, name, value, step):
            written.append((self.folder, name, value, step))

        def close(self):
            written.append("closed")

    module = type("Module", (), {"SummaryWriter": Writer})
    monkeypatch.setitem(__import__("sys").modules, "tensorboardX", module)
    with progress.Reporter(tmp_path, "expert", 1, quiet=True, tensorboard=True) as reporter:
        reporter.report(1, 64, 64, {"loss": np.asarray([1.0, 3.0])})
    assert written == [(str(tmp_path / "tensorboard"), "loss", 2.0, 64), "closed"]


def test_tensorboard_without_its_package_is_refused(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "tensorboardX", None)
    with pytest.raises(ValueError, match="pip install tensorboardX"):
        progress.Reporter(tmp_path, "expert", 1, quiet=True, tensorboard=True)
