"""Every verb has help; what goes wrong becomes one line on stderr and a status, with nothing half written."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import pytest

import mjx_cutting
from mjx_cutting.cli import app, main

HEAVY = {"jax", "jaxlib", "mujoco", "brax", "matplotlib"}


@pytest.fixture
def verb(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[], object]], None]:
    """Puts a verb `act` on the command line that does what it is given."""

    def put(action: Callable[[], object]) -> None:
        @dataclass(frozen=True)
        class Act:
            """Acts."""

            depth_m: float = 0.001
            """Depth, m."""

            def run(self) -> object:
                return action()

        monkeypatch.setitem(sys.modules, "mjx_cutting.cli.act", SimpleNamespace(Act=Act))
        monkeypatch.setitem(app.VERBS, "act", app.Verb("act", "Act", "acts"))

    return put


def failing(error: BaseException) -> Callable[[], object]:
    def action() -> object:
        raise error

    return action


def test_usage_names_every_verb(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    shown = capsys.readouterr().out
    assert all(f"  {name} " in shown for name in app.VERBS)
    assert main([]) == 2


@pytest.mark.parametrize("name", sorted(app.VERBS))
def test_every_verb_has_help_with_its_defaults(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main([*name.split(), "--help"])
    assert caught.value.code == 0
    shown = capsys.readouterr().out
    assert f"mjx-cutting {name}" in shown
    assert "(default" in shown or "(required)" in shown or name == "data list"


def test_group_shows_its_verbs(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["data", "--help"]) == 0
    shown = capsys.readouterr().out
    assert "data import" in shown and "export" not in shown
    assert main(["data"]) == 2


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"mjx-cutting {mjx_cutting.__version__}\n"


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["exprot"], "got the verb 'exprot'; expected one of: .*; did you mean 'export'?"),
        (["data", "lst"], "got the verb 'data lst'; expected one of: data list, data get"),
        (["xyz"], "got the verb 'xyz'; expected one of: demo, data list"),
    ],
)
def test_unknown_verb(words: list[str], told: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(words) == 2
    shown = capsys.readouterr()
    assert shown.out == "" and shown.err.startswith("error: ")
    import re

    assert re.search(told.replace("?", r"\?"), shown.err)


@pytest.mark.parametrize(
    "words", [["export"], ["export", "run", "--nonsense"], ["export", "run", "--pairs", "x"]]
)
def test_wrong_options_exit_with_two(words: list[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(words)
    assert caught.value.code == 2


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["train", "--ppo.clip", "3"], "got clip=3.0; expected between 0 and 1"),
        (["train", "--env.depth-m", "0", "1"], "expected 0 to 0.005 m"),
        (["train", "--steps", "0"], "got steps=0; expected at least 1"),
        (["adapt", "run"], "got neither gp nor model"),
    ],
)
def test_setting_out_of_range(words: list[str], told: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(words)
    assert caught.value.code == 2
    shown = capsys.readouterr()
    assert told in " ".join((shown.out + shown.err).replace("│", " ").split())


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["train", "--preset", "huge"], "got preset=huge; expected one of"),
        (["train", "--preset=smoke", "--model", "no.json"], "got no file at no.json"),
        (["train", "--preset=smoke", "--gp", "no.npz"], "got no file at no.npz"),
        (["adapt", "nowhere", "--gp", "no.npz"], "expected a policy.npz written by training"),
    ],
)
def test_what_is_not_there(
    words: list[str],
    told: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(words) == 2
    assert told in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_preset_shows_in_help(capsys: pytest.CaptureFixture[str]) -> None:
    from mjx_cutting.learning import presets

    for preset in ("smoke", "full"):
        envs = presets.EXPERT[preset].envs
        with pytest.raises(SystemExit):
            main(["train", "--preset", preset, "--help"])
        shown = " ".join(capsys.readouterr().out.replace("│", " ").split())
        assert f"environments side by side. (default: {envs})" in shown


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (ValueError("got 3; expected 2; mend it"), "error: got 3; expected 2; mend it\n"),
        (
            FileNotFoundError(2, "No such file or directory", "a/b"),
            "error: a/b: No such file or directory (there",
        ),
        (PermissionError(13, "Permission denied", "out"), "error: out: Permission denied (no permission"),
        (
            OSError(28, "No space left on device", "out"),
            "error: out: No space left on device (the disk is full;",
        ),
        (OSError("the network is away"), "error: the network is away\n"),
    ],
)
def test_error_becomes_one_line(
    error: Exception, told: str, verb: Callable[..., None], capsys: pytest.CaptureFixture[str]
) -> None:
    verb(failing(error))
    assert main(["act"]) == 2
    shown = capsys.readouterr().err
    assert shown.startswith(told)
    assert "Traceback" not in shown


def test_debug_shows_where(
    verb: Callable[..., None], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    verb(failing(ValueError("got 3")))
    assert main(["act", "--debug"]) == 2
    assert "Traceback" in capsys.readouterr().err
    monkeypatch.setenv(app.DEBUG, "1")
    assert main(["act"]) == 2
    assert "Traceback" in capsys.readouterr().err


def test_a_fault_of_the_program_is_not_hidden(verb: Callable[..., None]) -> None:
    verb(failing(AttributeError("a bug")))
    with pytest.raises(AttributeError):
        main(["act"])


def test_interrupt(verb: Callable[..., None], capsys: pytest.CaptureFixture[str]) -> None:
    verb(failing(KeyboardInterrupt()))
    assert main(["act"]) == 130
    assert "interrupted" in capsys.readouterr().err


def test_negative_verdict_is_the_status(verb: Callable[..., None]) -> None:
    verb(lambda: 1)
    assert main(["act"]) == 1
    verb(lambda: None)
    assert main(["act"]) == 0


def test_ctrl_c_in_a_process() -> None:
    code = (
        "import sys, time, types, dataclasses\n"
        "from mjx_cutting.cli import app\n"
        "def run(self): print('running', flush=True); time.sleep(60)\n"
        "act = dataclasses.make_dataclass('Act', [], namespace={'run': run})\n"
        "sys.modules['mjx_cutting.cli.act'] = types.SimpleNamespace(Act=act)\n"
        "app.VERBS['act'] = app.Verb('act', 'Act', 'acts')\n"
        "sys.exit(app.main(['act']))"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None and process.stdout.readline() == "running\n"
    process.send_signal(signal.SIGINT)
    _, told = process.communicate(timeout=30)
    assert process.returncode == 130
    assert "interrupted" in told and "Traceback" not in told


def test_reader_that_went_away_is_no_error(tmp_path: Path) -> None:
    line = f"{sys.executable} -m mjx_cutting data list | true"
    done = subprocess.run(["bash", "-c", line], capture_output=True, text=True, timeout=60, cwd=tmp_path)
    assert "Traceback" not in done.stderr and "error" not in done.stderr


@pytest.mark.parametrize("words", [["--help"], ["data", "list"], ["data", "check", "nowhere"]])
def test_light_verbs_load_no_jax(words: list[str]) -> None:
    code = (
        "import sys, json, mjx_cutting.cli as cli\n"
        f"cli.main({words!r})\n"
        "print(json.dumps(sorted({name.split('.')[0] for name in sys.modules})))"
    )
    started = time.monotonic()
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert not set(json.loads(done.stdout.splitlines()[-1])) & HEAVY
    assert time.monotonic() - started < 20


def test_script_and_module_are_the_same(command: Callable[..., subprocess.CompletedProcess[str]]) -> None:
    script = Path(sys.executable).with_name("mjx-cutting")
    assert script.exists(), "the package is not installed here: pip install -e ."
    done = subprocess.run(
        [str(script), "--help"], capture_output=True, text=True, timeout=60, env={**os.environ}
    )
    assert done.stdout == command("--help").stdout and done.returncode == 0
