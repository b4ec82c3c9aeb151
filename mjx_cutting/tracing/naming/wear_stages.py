"""Wear in its stages: an edge wears fast while it is sharp, then evenly, and fast again before it fails.

Wear that grows evenly is tried first, because fewer unknowns leave more to be sure of. Where its land leaves
more than noise, it is fitted with a run-in and with a late stage as well, then with both (either alone may
leave too much of the other to stand out), and each is kept where it explains more than chance does. Without a
run-in, force that rises fast and then slowly is a sensor's drift rather than wear; without a late stage, wear
that sets in late is scatter over the trials.
"""

from __future__ import annotations

from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from mjx_cutting.cutting import Tool
from mjx_cutting.cutting.effects.flank_wear import RATE, FlankWear
from mjx_cutting.tracing.naming.candidate import Candidate
from mjx_cutting.tracing.naming.place import Place

_RUN_IN = (0.03, 0.1, 0.3)
_LATE = (0.4, 0.6, 0.8)
_LATEST = 0.95
_LENGTHS = (np.log(1e-4), np.log(1e2))


class WearInStages(FlankWear):
    """Flank wear with a run-in, a late stage or both. Only kappa times the land shows, so the land at the
    longest length cut, `longest_m`, is held at what even wear makes there. Coordinates: kappa as of
    `FlankWear`; where it `runs_in`, the share of that land that does (logit) and the length it takes
    (logarithm, m); where it has a `late` stage, the share of the rest that is of it (logit) and where it
    begins, as a share of `_LATEST` of the longest length (logit)."""

    longest_m: ClassVar[float]
    runs_in: ClassVar[bool]
    late: ClassVar[bool]

    @classmethod
    def size(cls, tool: Tool) -> int:
        return 3 + 2 * (cls.runs_in + cls.late)

    @classmethod
    def build(cls, coordinates: Array, tool: Tool) -> WearInStages:
        steady, rest = FlankWear.build(coordinates[:3], tool), jnp.asarray(1.0)
        stages: dict[str, Array] = {}
        if cls.runs_in:
            share = jax.nn.sigmoid(coordinates[3])
            # where nothing runs in, no measurement keeps a descent from a length of zero or without end
            length = cls.longest_m * jnp.exp(jnp.clip(coordinates[4] - np.log(cls.longest_m), *_LENGTHS))
            land = share * RATE * cls.longest_m / -jnp.expm1(-cls.longest_m / length)
            stages |= {"initial_m": land, "run_in_m": length}
            rest = 1.0 - share
        if cls.late:
            share, start = jax.nn.sigmoid(coordinates[-2]), _LATEST * jax.nn.sigmoid(coordinates[-1])
            stages |= {
                "late_rate": rest * share * RATE / (1.0 - start),
                "late_start_m": start * cls.longest_m,
            }
            rest = rest * (1.0 - share)
        return cls(steady.kappa_n_m2, rest * RATE, **stages)

    @classmethod
    def starts(cls, tool: Tool) -> np.ndarray:
        ways = ([0.0, np.log(0.1 * cls.longest_m)] if cls.runs_in else []) + ([0.0, 0.0] if cls.late else [])
        return np.asarray([[0.3, 0.5, 0.3, *ways]])


def in_stages(found: Candidate, place: Place) -> Candidate:
    """The candidate `found`, or wear in stages where that is even wear and they explain more."""
    if found.kind is not FlankWear or not place.worth_it(found):
        return found
    longest_m = float(np.max(np.asarray(place.contest.problem.cut.cut_length_m)))
    x = np.asarray(found.fit.x)
    sharp = [np.array([0.0, np.log(share * longest_m)]) for share in _RUN_IN]
    blunt = [np.array([0.0, np.log(share / (_LATEST - share))]) for share in _LATE]
    running_in = place.better(found, _kind(longest_m, runs_in=True), [np.append(x, each) for each in sharp])
    late = place.better(found, _kind(longest_m, late=True), [np.append(x, each) for each in blunt])
    one = min(found, running_in, late, key=lambda each: each.heldout.nrmse)
    x = np.asarray(one.fit.x)
    if one is found:
        starts = [np.concatenate([x, *each]) for each in zip(sharp, blunt, strict=True)]
    elif one is running_in:
        starts = [np.append(x, each) for each in blunt]
    else:
        starts = [np.concatenate([x[:-2], each, x[-2:]]) for each in sharp]
    return place.better(one, _kind(longest_m, runs_in=True, late=True), starts)


def _kind(longest_m: float, runs_in: bool = False, late: bool = False) -> type[WearInStages]:
    of_it = {"longest_m": longest_m, "runs_in": runs_in, "late": late}
    return type("WearInStages", (WearInStages,), of_it)
