"""Which blind sessions the study traces: single effects, pairs, nothing missing, beyond any library."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

from .strengths import DRAWS, LEVELS, MILLS, OF_TEETH, OUTSIDE

PAIRS = (
    ("radial_runout", "size_effect"),
    ("radial_runout", "flank_wear"),
    ("radial_runout", "static_compliance"),
    ("radial_runout", "torque_ripple"),
    ("radial_runout", "robot_mode"),
    ("radial_runout", "material_periodicity"),
    ("unequal_pitch", "sensor_lowpass"),
    ("flank_wear", "thermal_drift"),
    ("flank_wear", "material_periodicity"),
    ("size_effect", "mains_pickup"),
    ("size_effect", "spindle_droop"),
    ("thermal_drift", "mains_pickup"),
)
"""Pairs met together on real machines; a design takes those that it can show."""

QUICK = ("radial_runout", "size_effect", "flank_wear", "mains_pickup", "sensor_lowpass", "thermal_drift")


@dataclass(frozen=True)
class Question:
    """One session to trace: kind "single", "pair", "nothing" or "outside"; hidden effects; strength; seed;
    what is left of its trials (a key of FEWER)."""

    kind: str
    design: str
    effects: tuple[str, ...]
    strength: str
    seed: int
    trials: str = "all"

    @property
    def key(self) -> str:
        """What a finished case is found again by."""
        left = "" if self.trials == "all" else f"/{self.trials}"
        return f"{self.design}/{'+'.join(self.effects) or 'nothing'}/{self.strength}/{self.seed}{left}"


def questions(
    designs: Iterable[str],
    seeds: Iterable[int],
    effects: Iterable[str] | None = None,
    quick: bool = False,
    strengths: Iterable[str] | None = None,
    trials: str = "all",
) -> Iterator[Question]:
    """All cases of the study, seed by seed, so that a run cut short still covers everything a little.

    Arguments: designs; seeds; effects: names to keep ("nothing", an effect, "a+b", or a kind such as
    "outside"), default all; quick: medium strength and few effects only; strengths: those of single
        effects to keep, default all; trials: what is left of each session, a key of FEWER.
    """
    wanted = None if effects is None else set(effects)
    kept = set(LEVELS if strengths is None else strengths)
    levels = ("medium",) if quick else tuple(LEVELS)
    for seed in seeds:
        for design in designs:
            for each in _of_seed(design, seed, levels, quick):
                names = "+".join(each.effects) or "nothing"
                asked = wanted is None or names in wanted or each.kind in wanted
                if asked and (each.kind != "single" or each.strength in kept):
                    yield replace(each, trials=trials)


def _of_seed(design: str, seed: int, levels: tuple[str, ...], quick: bool) -> Iterator[Question]:
    yield Question("nothing", design, (), "none", seed)
    for level in ("medium", *(each for each in levels if each != "medium")):
        for name, (designs, _) in DRAWS.items():
            if design in designs and (not quick or name in QUICK):
                yield Question("single", design, (name,), level, seed)
    for name in list(OUTSIDE)[:: 4 if quick else 1]:
        if not (name in OF_TEETH and design not in MILLS):
            yield Question("outside", design, (name,), "strong", seed)
    for pair in PAIRS[:: 6 if quick else 1]:
        if all(design in DRAWS[name][0] for name in pair):
            yield Question("pair", design, pair, "medium", seed)
