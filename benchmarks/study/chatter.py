"""Regenerative chatter: the delay equation of a flexible tool, all trials of a session side by side.

Each trial steps in equal angles of its own spindle, so that the surface left behind is a table by angle and
no delay is ever interpolated: h = reach of the tip now less the largest reach there before. Loss of contact
and cutting what several teeth left come by themselves. One mode an axis, advanced exactly over each step.

Loss of contact alone does not hold a large vibration, because it has no scale: all grows with the amplitude.
What does is the gullet: no chip is thicker than a tooth is high, about a quarter of the pitch.
"""

from __future__ import annotations

import numpy as np

from .milling import Array, Milling, shear

_TOOTH_HEIGHT = 0.25


def forces(cuts: list[Milling], begin_s: float, end_s: float, steps: int) -> list[tuple[Array, Array]]:
    """For each trial the times [S + 1] of the steps' edges and the mean force [S, 3] of each step, N.

    `steps` is the number of steps from one tooth to the next.
    """
    trials, teeth = len(cuts), cuts[0].teeth
    bins = teeth * steps
    step = 2.0 * np.pi / bins
    angle = step * (np.arange(bins) + 0.5)
    sine, cosine = np.sin(angle), np.cos(angle)
    arcs = np.array([cut.arc() for cut in cuts])
    over = np.minimum(arcs[:, 1:], angle + step / 2) - np.maximum(arcs[:, :1], angle - step / 2)
    engaged = np.clip(over / step, 0.0, 1.0)
    speed = np.array([cut.speed_rev_s for cut in cuts])
    feed = np.array([cut.feed_m_s for cut in cuts])
    width = np.array([cut.width_m for cut in cuts])
    p = cuts[0].effects["regenerative_chatter"]
    dt = step / (2.0 * np.pi * speed)
    half, feed_step = 0.5 * dt, feed * dt
    advance = _exact(np.asarray(p["frequency_hz"])[:, None], np.asarray(p["damping"])[:, None], dt)
    give = np.asarray(p["compliance_m_n"])[:, None]
    count = int(np.ceil((end_s - begin_s) * speed.max() * bins)) + 1
    reach = np.stack([cut.reaches() for cut in cuts])
    chip_k = (width[:, None] * np.stack([cut.chip_n_m2 for cut in cuts])).T[:, :, None]
    edge_k = (width[:, None] * np.stack([cut.edge_n_m for cut in cuts])).T[:, :, None]
    surface = -feed[:, None] / (speed[:, None] * teeth) * sine
    moved, rate = np.zeros((2, trials)), np.zeros((2, trials))
    made = np.zeros((count, 3, trials))
    behind = -np.arange(teeth) * steps
    thickest = _TOOTH_HEIGHT * 2.0 * np.pi * cuts[0].radius_m / teeth
    phase = np.array([cut.phase_rad for cut in cuts]) + 2.0 * np.pi * speed * begin_s
    start = begin_s - np.mod(phase, step) / (2.0 * np.pi * speed)
    first = np.floor(phase / step).astype(int)
    rows = np.arange(trials)[:, None]
    effects = cuts[0].effects
    bent = bool({"size_effect", "ploughing"} & set(effects))
    for index in range(count):
        at = (first[:, None] + index + behind) % bins
        middle = moved + half * rate
        s, c = sine[at], cosine[at]
        tip = (feed_step * (index + 0.5) + middle[0])[:, None] * s + middle[1][:, None] * c + reach
        before = surface[rows, at]
        bare = np.minimum(tip - before, thickest)
        surface[rows, at] = np.maximum(before, tip)
        touch = engaged[rows, at] * (bare > 0.0)
        sheared = touch * (shear(np.maximum(bare, 0.0), effects) if bent else bare)
        tangential, radial, axial = chip_k * sheared + edge_k * touch
        load = made[index]
        load[0] = -(tangential * c + radial * s).sum(1)
        load[1] = (tangential * s - radial * c).sum(1)
        load[2] = -axial.sum(1)
        rest = give * load[:2]
        away = moved - rest
        moved, rate = (
            advance[0] * away + advance[1] * rate + rest,
            advance[2] * away + advance[3] * rate,
        )
    edges = np.arange(count + 1)
    return [(start[i] + edges * dt[i], made[:, :, i]) for i in range(trials)]


def _exact(frequency_hz: Array, damping: Array, dt: Array) -> tuple[Array, Array, Array, Array]:
    """Transition of (x, x') over a step of free motion, each [2, trials]."""
    w = 2.0 * np.pi * frequency_hz
    d = w * np.sqrt(1.0 - damping**2)
    decay, c, s = np.exp(-damping * w * dt), np.cos(d * dt), np.sin(d * dt)
    lean = damping * w / d
    return decay * (c + lean * s), decay * s / d, -decay * w * w / d * s, decay * (c - lean * s)


def onto_grid(edges: Array, force: Array, begin_s: float, count: int, rate_hz: float) -> Array:
    """[count, 3] mean force about the times begin_s + i / rate_hz: impulses kept exactly."""
    wanted = begin_s + (np.arange(count + 1) - 0.5) / rate_hz
    made = np.empty((count, 3))
    for axis in range(3):
        total = np.concatenate([[0.0], np.cumsum(force[:, axis] * np.diff(edges))])
        made[:, axis] = np.diff(np.interp(wanted, edges, total)) * rate_hz
    made[1:-1] = 13.0 / 12.0 * made[1:-1] - (made[:-2] + made[2:]) / 24.0
    return made
