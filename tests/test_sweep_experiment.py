"""The search for settings: one study for several processes, and a toy search that goes on."""

import json
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from experiments import launch, sweep

SEARCH = textwrap.dedent(
    """
    import sys
    from pathlib import Path
    import numpy as np
    from experiments.sweep import Config, search

    def rewards(proposals):
        return np.asarray([[-(np.log(p["learning_rate"] / 1e-3) ** 2), np.nan if p["clip"] > 0.39 else 0.0]
                           for p in proposals])

    config = Config(searched=("learning_rate", "clip"), trials=12, width=2, member=int(sys.argv[2]))
    print(len(search(config, Path(sys.argv[1]), rewards).trials))
    """
)


def test_processes_share_one_study(tmp_path):
    words = [sys.executable, "-c", SEARCH, str(tmp_path)]
    root = Path(sweep.__file__).parent.parent
    both = [subprocess.Popen([*words, str(i)], stdout=subprocess.PIPE, text=True, cwd=root) for i in range(2)]
    counted = [int(each.communicate(timeout=240)[0]) for each in both]
    assert [each.returncode for each in both] == [0, 0]
    assert 12 <= max(counted) <= 16  # each may have been at its last proposals
    config = sweep.Config(searched=("learning_rate", "clip"), trials=12)
    study = sweep.search(config, tmp_path, None)  # nothing is left to train
    told = sweep.summary(study)
    assert len({trial["settings"]["learning_rate"] for trial in told["trials"]}) == len(told["trials"])
    assert told["best"]["reward"] == max(t["reward"] for t in told["trials"] if t["state"] == "complete")
    low, high, _ = sweep.RANGES["learning_rate"]
    assert all(low <= trial["settings"]["learning_rate"] <= high for trial in told["trials"])


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_sweep_goes_on_with_the_study_it_finds(tmp_path):
    arguments = ["--preset", "smoke", "--out", str(tmp_path)]
    assert launch.launch(sweep.run, sweep.PRESETS, arguments) == 0
    told = json.loads((tmp_path / "sweep.json").read_text())
    assert len(told["trials"]) == 2
    assert told["best"]["reward"] < 0
    assert set(told["best"]["settings"]) == {"learning_rate", "discount"}
    assert launch.launch(sweep.run, sweep.PRESETS, arguments) == 0
    assert json.loads((tmp_path / "sweep.json").read_text()) == told


def test_searches_that_cannot_be_are_refused():
    for fields, told in (({"searched": ("envs",)}, "names out of"), ({"width": 0}, "got width=0")):
        with pytest.raises(ValueError, match=told):
            sweep.Config(**fields)
