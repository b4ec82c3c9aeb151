"""What is beyond any library: gains that switch or walk, maps of position, cross terms, memory, gears."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .designs import Plan, TrueCut, stream
from .milling import Array, Milling

Params = dict[str, Any]


def gain(
    time: Array, place: Array, force: Array, session: Plan, cut: TrueCut, drawn: dict[str, Params], index: int
) -> Array:
    """[T] factor on the process force."""
    made = np.ones(len(time))
    rate = 1.0 / (time[1] - time[0])
    if "gain_switching" in drawn:
        p = drawn["gain_switching"]
        rng = stream(p["seed"], "switch", index)
        flips = np.cumsum(rng.exponential(0.25 * cut.duration_s, 200)) - cut.duration_s
        made *= 1.0 + p["size"] * (np.searchsorted(flips, time) % 2)
    if "position_slope" in drawn:
        p = drawn["position_slope"]
        rng = stream(p["seed"], "map")
        slope, bend, centre = rng.normal(1.0, 0.3), rng.normal(0.0, 1.0), rng.uniform(0.3, 0.7)
        whole = max(each.path_m for each in session.cuts)
        x = place / whole
        made *= 1.0 + p["size"] * (slope * x + bend * ((x - centre) ** 2 - centre**2))
    if "random_walk_gain" in drawn:
        p = drawn["random_walk_gain"]
        rng = stream(p["seed"], "walk", index)
        knots = np.arange(time[0], time[-1] + 0.2, 0.1)
        steps = p["size"] * np.sqrt(0.1 / cut.duration_s) * rng.normal(size=len(knots))
        made *= np.exp(np.interp(time, knots, np.cumsum(steps)))
    if "feed_speed_cross" in drawn:
        feeds, speeds = (np.log([getattr(c, n) for c in session.cuts]) for n in ("feed_m_s", "speed_rev_s"))
        feed = (np.log(cut.feed_m_s) - feeds.mean()) / feeds.std()
        speed = (np.log(cut.speed_rev_s) - speeds.mean()) / speeds.std()
        made *= 1.0 + drawn["feed_speed_cross"]["size"] * 0.7 * feed * speed
    if "speed_softening" in drawn:
        middle = np.exp(np.mean(np.log([each.speed_rev_s for each in session.cuts])))
        made *= (cut.speed_rev_s / middle) ** (-4.0 * drawn["speed_softening"]["size"])
    if "previous_force" in drawn and cut.kind == "cut":
        usual = 30.0 if session.design == "saw" else 300.0
        before = _mean_before(np.linalg.norm(force, axis=1), window=int(rate), late=int(0.5 * rate))
        made *= 1.0 + drawn["previous_force"]["size"] * np.tanh(before / usual - 0.5)
    return made


def _mean_before(size: Array, window: int, late: int) -> Array:
    """[T] mean over the window that ended `late` samples ago; the start of the record where there is none."""
    total = np.concatenate([[0.0], np.cumsum(size)])
    now = np.maximum(np.arange(1, len(size) + 1) - late, 1)
    then = np.maximum(now - window, 0)
    return (total[now] - total[then]) / (now - then)


def wander(work: Milling, drawn: dict[str, Params], index: int) -> None:
    """Gives the spindle a wander of its angle: a random walk smoothed over a fifth of a turn, rad; or what a
    worn gear does, once in several turns."""
    if "worn_gear" in drawn:
        p = drawn["worn_gear"]
        order = stream(p["seed"], "gear").uniform(0.2, 0.45)
        start = stream(p["seed"], "gear", index).uniform(0.0, 2.0 * np.pi)
        work.wander = lambda angle: 0.15 * p["size"] / order * np.sin(order * angle + start)
    if "speed_wander" not in drawn:
        return
    p = drawn["speed_wander"]
    rng = stream(p["seed"], "wander", index)
    knots = np.arange(-400, 4000) * (2.0 * np.pi / 5.0)
    steps = rng.normal(size=len(knots)) * p["size"] * 0.05
    walk = np.zeros(len(knots))
    for i in range(1, len(knots)):
        walk[i] = 0.995 * walk[i - 1] + steps[i]
    work.wander = lambda angle: np.interp(angle, knots, walk)


def stick(work: Milling, drawn: dict[str, Params], index: int) -> None:
    """Lets a chip stick to one tooth now and then, for some turns, which makes it cut deeper."""
    if "sticking_chip" not in drawn:
        return
    p = drawn["sticking_chip"]
    tooth = int(stream(p["seed"], "which").integers(work.teeth))
    rng = stream(p["seed"], "sticks", index)
    changes = np.cumsum(rng.exponential(8.0, 4000)) - 400.0
    thick = 2.0 * p["size"] * work.feed_m_s / (work.speed_rev_s * work.teeth)

    def more(number: NDArray[np.integer]) -> Array:
        sticks = np.searchsorted(changes, number // work.teeth) % 2
        return np.where(number % work.teeth == tooth, thick * sticks, 0.0)

    work.stuck = more


def spiked(record: Array, drawn: dict[str, Params], index: int) -> Array:
    """Hits single samples with large values."""
    if "spikes" not in drawn:
        return record
    p = drawn["spikes"]
    rng = stream(p["seed"], "spikes", index)
    made = record.copy()
    hit = rng.random(len(record)) < 0.02 * p["size"]
    made[hit] += rng.normal(size=(int(hit.sum()), record.shape[1])) * 8.0 * np.nanstd(record, axis=0)
    return made
