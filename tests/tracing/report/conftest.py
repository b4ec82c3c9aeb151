"""Tracings made by hand: the numbers are invented, the parts are the real classes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

from mjx_cutting.cutting import ForceModel, Material, Tool, effect_class
from mjx_cutting.tracing.fitting.fit import Fit
from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.tracing.fitting.prediction import Prediction
from mjx_cutting.tracing.fitting.problem import TOLERANCE
from mjx_cutting.tracing.naming.candidate import Candidate, Round
from mjx_cutting.tracing.naming.decision import Decision
from mjx_cutting.tracing.naming.intervals import Interval
from mjx_cutting.tracing.naming.search import Search
from mjx_cutting.tracing.records.lines import compress
from mjx_cutting.tracing.records.noise import noise_floor
from mjx_cutting.tracing.telling.dependence import Dependence
from mjx_cutting.tracing.telling.verdict import verdict
from mjx_cutting.tracing.told import Tracing
from mjx_cutting.trials.dataset import Dataset, Sensor, ToolInfo, Trial

RATE_HZ, SPEED_REV_S, SECONDS = 2000.0, 25.0, 0.5
ONCE_N = 40.0
PROBLEM = SimpleNamespace(tolerance=TOLERANCE)  # the rest of a fitting problem is not read


@pytest.fixture(scope="session")
def make_tracing() -> Callable[..., Tracing]:
    """Call it with a verdict's word and what differs from the usual: five cuts with two teeth."""
    return _make


def _make(
    word: str = "partly explained",
    *,
    trials: int = 5,
    teeth: int = 2,
    same_feed: bool = False,
    band_hz: tuple[float, float] = (0.0, 250.0),
    name: str = "made up",
    files: str = "t{:03d}.csv",
    **dataset_fields: Any,
) -> Tracing:
    """A tracing with radial runout named, refused or tied, as its word says."""
    feeds = np.full(trials, 0.004) if same_feed else np.linspace(0.002, 0.01, trials)
    records = [_record(index, feed, teeth) for index, feed in enumerate(feeds)]
    dataset = Dataset(
        name=name,
        tool=ToolInfo("end_mill", teeth, 0.02),
        sensor=Sensor(RATE_HZ),
        trials=tuple(
            _trial(files.format(index), feed, record["measured"])
            for index, (feed, record) in enumerate(zip(feeds, records, strict=True))
        ),
        **dataset_fields,
    )
    named = word in ("explained", "partly explained", "ambiguous")
    lines = compress(dataset, band_hz)
    before = tuple(_prediction(t.file, r, r["base"]) for t, r in zip(dataset.trials, records, strict=True))
    after = tuple(_prediction(t.file, r, r["final"]) for t, r in zip(dataset.trials, records, strict=True))
    found = _search(lines.energy_n2, teeth, named)
    depends = (
        Dependence("spindle order", 0.0, 0.9, 0.1, "something once per revolution"),
        Dependence("feed", 0.2, 0.4, 0.1, "an edge law"),
    )
    left = (
        depends
        if word in ("partly explained", "unexplained")
        else (replace(depends[0], p_value=0.7), depends[1])
    )
    evidence = {"radial_runout": ["a line of 40 N"]}
    said = verdict(dataset, lines, found, (), depends, left, evidence, noise_floor(dataset, lines))
    pair = {
        "names": ["radial_runout", "unequal_pitch"],
        "cosine": 0.97,
        "separating_trial": "a feed range of 10:1",
    }
    said |= {"verdict": word, "ambiguous": [pair] if word == "ambiguous" else []}
    base_model, model = _model(teeth, False), _model(teeth, named)
    last = after if named else before
    return Tracing(
        dataset, lines, found, (), base_model, model, before, last,
        depends_before=depends, depends_after=left, verdict=said,
    )  # fmt: skip


def _record(index: int, feed: float, teeth: int) -> dict[str, Any]:
    rng = np.random.default_rng(index)
    time = np.arange(round(RATE_HZ * SECONDS)) / RATE_HZ
    angle = 2 * np.pi * SPEED_REV_S * time + 0.3 * index
    passing = 2e4 * feed * (1.0 - np.cos(teeth * angle))[:, None] * np.array([1.0, 0.7, 0.2])
    final = passing + ONCE_N * np.cos(angle)[:, None] * np.array([1.0, 0.0, 0.0])
    return {
        "time": time,
        "angle": angle,
        "base": passing,
        "final": final,
        "measured": final + rng.normal(size=final.shape),
    }


def _trial(file: str, feed: float, measured: np.ndarray) -> Trial:
    return Trial(
        file=file,
        kind="cut",
        milling="conventional",
        spindle_speed_rev_s=SPEED_REV_S,
        feed_speed_m_s=feed,
        radial_depth_m=0.002,
        axial_width_m=0.001,
        time_s=np.arange(len(measured)) / RATE_HZ,
        force_n=measured,
    )


def _prediction(file: str, record: dict[str, Any], predicted: np.ndarray) -> Prediction:
    return Prediction(
        file, record["time"], record["angle"], record["measured"], predicted, SPEED_REV_S, np.zeros(3)
    )


def _model(teeth: int, named: bool, folds: int | None = None) -> ForceModel:
    runout = effect_class("radial_runout")

    def many(value: float) -> Any:
        return np.array(value) if folds is None else value * np.linspace(0.98, 1.02, folds)

    material = Material(many(8e8), many(2e4), many(3e8), many(1.5e4), many(0.0), many(0.0))
    effects = (runout(many(1.2e-5), many(0.0)),) if named else ()
    return ForceModel(Tool("end_mill", teeth, 0.02), material, effects)


def _search(energy: np.ndarray, teeth: int, named: bool) -> Search:
    trials = len(energy)

    one = jnp.ones(())

    def fit(effects: bool) -> Fit:
        return Fit(jnp.zeros(6), one, one, jnp.ones((trials, 3)), _model(teeth, effects), one)

    def held(share: float, effects: bool) -> HeldOut:
        fits = replace(fit(effects), model=_model(teeth, effects, folds=trials))
        return HeldOut(share**2 * energy, energy, fits, np.arange(trials))

    strength = {
        "offset_m": Interval(1.2e-5, 1.1e-5, 1.3e-5, "m"),
        "angle_rad": Interval(0.0, 0.0, 0.0, "rad"),
    }
    good = Decision(True, True, 1e-20, 0.2, float("nan"), strength, ())
    bad = Decision(False, False, 0.4, -0.01, 0.02, {}, ("error does not fall", "runs to <its> edge"))
    runout = Candidate(effect_class("radial_runout"), fit(True), held(0.1, True), good, 5)
    if not named:
        runout = replace(runout, heldout=held(0.3, True), decision=bad)
    pitch = Candidate(effect_class("unequal_pitch"), fit(False), held(0.31, False), bad, 5)
    base, final = held(0.3, False), held(0.1, True)
    rounds = [Round(base, (), (runout, pitch), runout if named else None)]
    if named:
        rounds.append(Round(final, (), (pitch,), None))
    last = final if named else base
    kinds = (effect_class("radial_runout"),) if named else ()
    told = (strength,) if named else ()
    return Search(PROBLEM, fit(False), base, kinds, fit(named), last, tuple(rounds), told)  # type: ignore[arg-type]
