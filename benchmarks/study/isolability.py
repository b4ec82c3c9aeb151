"""What the trials of a session can show, from the simulator alone: before any tracing, apart from its code.

The mark of an effect is what it changes in the noise-free records. From it is taken what the base model could
imitate: its six constants, and each trial's phase, speed and bias (one bias for all where the sensor was
zeroed once a session). What is left, as a share of the mark, is the survival; in units of the sensor's noise,
the number of standard errors at which the effect stands; and the cosine between two survivors says how far
one can be taken for the other. Finite strengths, so a secant rather than a slope.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .designs import Plan, plan, stream
from .generator import recorded
from .strengths import DRAWS, draw

Array = NDArray[np.float64]
_QUIET = 1e-9
_TURN_RAD = 1e-3


@lru_cache(maxsize=4)
def isolability(
    design: str, seed: int, strength: str = "medium", effects: tuple[str, ...] = tuple(DRAWS)
) -> dict[str, dict[str, Any]]:
    """For every effect of a design: survival, standard_errors, nearest other effect and the cosine."""
    left: dict[str, Array] = {}
    made: dict[str, dict[str, Any]] = {}
    bases: dict[str, tuple[list[Array], list[Array]]] = {}
    for name in (each for each in effects if design in DRAWS[each][0]):
        session = plan(design, seed, (name,))
        drawn = {name: draw(name, session, strength, stream(seed, design, name))}
        kind = f"{session.sensor.zeroed} {session.cuts[0].milling}"
        if kind not in bases:
            bases[kind] = _imitations(session, seed)
        base, basis = bases[kind]
        mark = [a - b for a, b in zip(_signals(session, drawn, seed), base, strict=True)]
        kept = _without(mark, basis, session.sensor.zeroed == "session")
        flat = np.concatenate([each.ravel() for each in kept])
        whole = np.sqrt(sum(float((each**2).sum()) for each in mark))
        size = float(np.linalg.norm(flat))
        made[name] = {"survival": size / max(whole, 1e-300), "standard_errors": size}
        left[name] = flat / max(size, 1e-300)
    for name, mark in left.items():
        others = {o: abs(float(mark @ left[o])) for o in left if o != name and left[o].size == mark.size}
        nearest = max(others, key=others.__getitem__, default=None)
        made[name] |= {"nearest": nearest, "cosine": others[nearest] if nearest else 0.0}
    return made


def _signals(session: Plan, drawn: dict[str, Any], seed: int) -> list[Array]:
    """Noise-free records [T, C] of every trial in units of the noise."""
    scale = np.array([1.0, 0.01]) if session.design == "drill" else np.asarray(session.sensor.noise_std_n)
    return [trial.signals / scale for trial in recorded(session, drawn, seed, noise=_QUIET)[1]]


def _imitations(session: Plan, seed: int) -> tuple[list[Array], list[Array]]:
    """The base records, and by trial what phase, speed and the constants change in them [K, T, C]."""
    base = _signals(session, {}, seed)
    zero = np.zeros(3)
    columns = []
    turned = [replace(cut, phase_rad=cut.phase_rad + _TURN_RAD) for cut in session.cuts]
    faster = [
        replace(cut, speed_rev_s=cut.speed_rev_s * (1.0 + _TURN_RAD / (400.0 * cut.duration_s)))
        for cut in session.cuts
    ]
    for cuts in (turned, faster):
        moved = _signals(replace(session, cuts=tuple(cuts)), {}, seed)
        columns.append([a - b for a, b in zip(moved, base, strict=True)])
    bias = _signals(replace(session, chip_n_m2=zero, edge_n_m=zero), {}, seed)
    for index in range(6):
        constants = np.zeros(6)
        constants[index] = [*session.chip_n_m2, *session.edge_n_m][index]
        alone = replace(session, chip_n_m2=constants[:3], edge_n_m=constants[3:])
        columns.append([a - b for a, b in zip(_signals(alone, {}, seed), bias, strict=True)])
    return base, [np.stack([each[i] for each in columns]) for i in range(len(base))]


def _without(mark: list[Array], basis: list[Array], shared_bias: bool) -> list[Array]:
    """The mark less its least-squares fit by what the base model can imitate."""
    own, common, targets = [], [], []
    for trial, columns in zip(mark, basis, strict=True):
        samples, channels = trial.shape
        level = np.einsum("ij,t->ijt", np.eye(channels), np.ones(samples)).transpose(0, 2, 1)
        local = columns[:2] if shared_bias else np.concatenate([columns[:2], level])
        wide = np.concatenate([columns[2:], level]) if shared_bias else columns[2:]
        left = _orthonormal(local.reshape(len(local), -1).T)
        shared = wide.reshape(len(wide), -1).T
        own.append(left)
        common.append(shared - left @ (left.T @ shared))
        flat = trial.ravel()
        targets.append(flat - left @ (left.T @ flat))
    stacked, target = _orthonormal(np.concatenate(common)), np.concatenate(targets)
    target = target - stacked @ (stacked.T @ target)
    ends = np.cumsum([each.size for each in mark])[:-1]
    return [part.reshape(each.shape) for part, each in zip(np.split(target, ends), mark, strict=True)]


def _orthonormal(columns: Array) -> Array:
    """A basis of the columns' span, without directions too small to count."""
    norms = np.linalg.norm(columns, axis=0)
    scaled = columns[:, norms > 0.0] / norms[norms > 0.0]
    values, vectors = np.linalg.eigh(scaled.T @ scaled)
    kept = values > 1e-10
    return scaled @ (vectors[:, kept] / np.sqrt(values[kept]))
