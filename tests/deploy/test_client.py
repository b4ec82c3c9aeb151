"""What a controller makes of COMMANDs: interpolation, and a stop of its own when they end."""

from __future__ import annotations

import numpy as np
import pytest

from mjx_cutting.deploy.client import Follower
from mjx_cutting.deploy.protocol import Cause, Command, Mode, Welcome

MS = 1_000_000
WELCOME = Welcome(
    bytes(32), 20_000, 100_000, 0.0125, (50.0, 50.0, 50.0, -0.8, 0.0), (3000.0, 3000.0, 3000.0, 1.0, 0.002),
    (4.1, 4.1, 4.1, 2.0, 0.002), (2450.0, 2080.0, 530.0, 0.0, 0.0),
)  # fmt: skip


def command(feed: float, depth: float, mode: Mode = Mode.RUNNING) -> Command:
    return Command(1, mode, Cause.NONE, 20_000, 100_000, 0, (2000.0, 1000.0, 500.0, feed, depth))


def test_set_points_are_interpolated_over_the_period() -> None:
    follower = Follower(WELCOME)
    follower.take(command(-1.0, 0.0), 0)
    follower.at(20 * MS)
    follower.take(command(0.0, 0.001), 20 * MS)
    feeds = [follower.at(t * MS)[3] for t in range(20, 60, 5)]
    np.testing.assert_allclose(feeds, [-1.0, -0.75, -0.5, -0.25, 0.0, 0.0, 0.0, 0.0])
    assert follower.at(60 * MS)[4] == pytest.approx(0.001)


def test_a_late_command_bends_the_path_without_a_jump() -> None:
    follower = Follower(WELCOME)
    draw, last, t = np.random.default_rng(0), None, 0
    for at in range(1000):
        if draw.random() < 0.05:
            follower.take(command(draw.uniform(-0.8, 1.0), 0.001), t)
        t = at * MS
        now = follower.at(t)[3]
        assert last is None or abs(now - last) < 1.9 / 20 * 1.01  # largest change a period could ask for
        last = now


def test_silence_ramps_to_standstill_and_stays_there() -> None:
    follower = Follower(WELCOME)
    for t in range(0, 200, 20):
        follower.take(command(0.5, 0.001), t * MS)
        follower.at(t * MS)
    held = follower.at(280 * MS)
    assert held[3] == 0.5 and not follower.silent  # 100 ms are held
    points = np.array([follower.at(t * MS) for t in range(281, 1300)])
    assert follower.silent and follower.standing and points[-1, 4] == 0.0
    assert np.all(np.abs(np.diff(points[:, 3])) <= 2.0 * 1e-3 + 1e-12)
    np.testing.assert_array_equal(points[:, :3], np.tile(held[:3], (len(points), 1)))  # the tool stays held
    follower.take(command(0.5, 0.001), 1301 * MS)  # the server is back and still RUNNING
    assert follower.at(1400 * MS)[3] == -1.0
    follower.take(command(-1.0, 0.0, Mode.FAULT), 1401 * MS)
    follower.take(command(0.0, 0.001), 1420 * MS)  # it was stopped, armed and started again
    assert follower.at(1440 * MS)[3] == pytest.approx(0.0)
