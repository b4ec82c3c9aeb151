"""The next trial to run, and what a reader must know before believing a report.

The trials proposed are the cheap ones that settle most confusions: an air cut, a feed range of ten to one,
another depth, a small change of speed, the first trial repeated last. Which of them comes first follows from
what the verdict leaves open, then from what the trials at hand lack.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mjx_cutting._report.quantities import number, percent
from mjx_cutting.tracing.told import Tracing
from mjx_cutting.trials.dataset import Trial

_FEW_TRIALS = 6
_FEED_RANGE = 10.0
_AIR = "an air cut at three spindle speeds, that of the cuts among them"
_FOR_COVARIATE = {
    "spindle order": (
        _AIR,
        "a once-per-revolution force that is there in air is unbalance or the spindle; one that is not "
        "comes from the teeth",
    ),
    "tooth phase": (
        "one of the cuts again at 3 % more and at 3 % less spindle speed, same feed per tooth",
        "what follows the tool's angle is the edge; what stays at a frequency in hertz is a resonance or "
        "a filter",
    ),
    "time in trial": (
        "one of the cuts again over the same stretch at twice the feed",
        "what stays at its place belongs to the sheet or the clamping; what stays at its time is drift",
    ),
    "feed": (
        "the same cut over a feed range of at least ten to one",
        "it separates an edge law that bends with chip thickness from a constant edge force",
    ),
    "spindle speed": (
        "one of the cuts at 1 % and at 3 % more and less spindle speed",
        "it separates a resonance at a fixed frequency from a law that depends on cutting speed",
    ),
    "radial depth": (
        "the same cut at a quarter of the depth",
        "it separates compliance and friction on the engaged area from the edge law",
    ),
    "cut length": (
        "the first trial again at the end, and once more with a fresh tool",
        "wear stays until the tool is changed; drift does not care for the tool",
    ),
    "clock time": (
        "an air cut at the start and one at the end of the session, without zeroing between",
        "thermal drift of the sensor shows in air; wear does not",
    ),
    "trial": (
        "one of the cuts three times over, in one sheet and without unclamping anything",
        "a force that then repeats differs from sheet to sheet or with the clamping; one that does not, with "
        "the sensor",
    ),
    "previous force": (
        "a record with the spindle stopped, and a tap test on tool and robot",
        "mains pickup and the frequencies of the structure show without any cutting",
    ),
    "another axis": (
        "a known weight hung on the tool along one axis after the other",
        "crosstalk of the sensor shows without cutting; forces turned by the cut do not",
    ),
}


@dataclass(frozen=True)
class Proposal:
    """A trial to run and what it settles."""

    trial: str
    settles: str


def proposals(tracing: Tracing, most: int = 5) -> list[Proposal]:
    """Returns trials to run, the most useful first."""
    found = [Proposal(pair["separating_trial"], f"it separates {' from '.join(map(_words, pair['names']))}")
             for pair in tracing.verdict["ambiguous"]]  # fmt: skip
    for name in tracing.verdict["remaining"]["depends_on"]:
        if name in _FOR_COVARIATE and not (name == "spindle order" and _has_air(tracing)):
            found.append(Proposal(*_FOR_COVARIATE[name]))
    found += _lacking(tracing)
    first = {each.trial: each for each in reversed(found)}
    return [each for each in found if first[each.trial] is each][:most]


def caveats(tracing: Tracing) -> list[str]:
    """Returns what limits the conclusions, one sentence each."""
    dataset, lines = tracing.dataset, tracing.lines
    trials = cut_trials(tracing)
    low, high = lines.band_hz
    if low <= 0.0 and high >= 0.499 * dataset.sensor.sample_rate_hz:
        said = [f"Everything up to half the sampling rate, {number(high)} Hz, was compared, unfiltered."]
    else:
        said = [
            f"Only {number(low)} to {number(high)} Hz was compared, the band in which the sensor is "
            f"trusted; {percent(outside_band(tracing))} of the energy of the measured forces lies outside "
            "it and is not judged."
        ]
    if len(trials) < _FEW_TRIALS:
        said.append(
            f"{len(trials)} cut trials are few: the intervals rest on as many refits, each without one of "
            "them, and are wide."
        )
    feeds = [trial.feed_speed_m_s / trial.spindle_speed_rev_s for trial in trials]
    if max(feeds) < _FEED_RANGE * min(feeds):
        said.append(
            f"Feed per tooth covers a range of {max(feeds) / max(min(feeds), 1e-12):.2g} to 1; below "
            "10 to 1 an edge force, a size effect and ploughing are hard to tell apart."
        )
    if all(trial.spindle_angle_rad is None for trial in trials):
        off = max(
            abs(p.speed_rev_s / t.spindle_speed_rev_s - 1.0)
            for p, t in zip(tracing.after, trials, strict=True)
        )
        said.append(
            "The spindle angle was not recorded: the phase of every trial was fitted and its speed "
            f"estimated (at most {number(100 * off, 1)} % off the nominal one), so a constant delay cannot "
            "be seen."
        )
    said += [f"{each[0].upper()}{each[1:]}." for each in tracing.caveats]
    if dataset.sensor.zeroed == "trial":
        said.append(
            "The sensor was zeroed before each trial, so every trial has a bias of its own: slow drift and "
            "a constant friction force cannot be seen."
        )
    if dataset.sensor.units == "arbitrary":
        said.append("The forces are in arbitrary units; the mechanistic constants carry the same scale.")
    said.append(_floor_source(tracing))
    said += [f"{text[:1].upper()}{text[1:].rstrip('.')}." for text in dataset.warnings]
    return said


def cut_trials(tracing: Tracing) -> list[Trial]:
    """Returns the cut trials in the order of the predictions."""
    return [trial for trial in tracing.dataset.trials if trial.kind == "cut"]


def outside_band(tracing: Tracing) -> float:
    """Returns the share of the measured energy that lies outside the band."""
    whole = sum(float(np.sum(trial.force_n**2)) for trial in cut_trials(tracing))
    return float(np.clip(1.0 - tracing.lines.energy_n2.sum() / max(whole, 1e-300), 0.0, 1.0))


def held_out_how(tracing: Tracing) -> str:
    """Returns how trials were held out, in words."""
    fold = tracing.search.base.fold
    if len(np.unique(fold)) == len(fold):
        return "each trial predicted by a model fitted to all the others"
    tools = {trial.tool_id for trial in cut_trials(tracing)}
    if len(tools) == len(np.unique(fold)) and None not in tools:
        return "the trials of each tool predicted by a model fitted to those of the other tools"
    return f"trials in {len(np.unique(fold))} groups, each predicted by a model fitted to the other groups"


def _lacking(tracing: Tracing) -> list[Proposal]:
    trials = cut_trials(tracing)
    feeds = [trial.feed_speed_m_s / trial.spindle_speed_rev_s for trial in trials]
    found = []
    if not _has_air(tracing):
        found.append(
            Proposal(
                _AIR,
                "it measures noise and bias, and shows unbalance and mains pickup without cutting",
            )
        )
    if max(feeds) < _FEED_RANGE * min(feeds):
        found.append(Proposal(*_FOR_COVARIATE["feed"]))
    if len({round(60.0 * trial.spindle_speed_rev_s) for trial in trials}) == 1:
        found.append(Proposal(*_FOR_COVARIATE["spindle speed"]))
    if len({trial.radial_depth_m for trial in trials}) == 1 and trials[0].milling != "slot":
        found.append(Proposal(*_FOR_COVARIATE["radial depth"]))
    if len({trial.axial_width_m for trial in trials}) == 1 and trials[0].milling == "slot":
        found.append(
            Proposal(
                "the same slot at a quarter of the width of cut",
                "forces that do not scale with it are not the edge's",
            )
        )
    return found


def _floor_source(tracing: Tracing) -> str:
    if _has_air(tracing):
        return "The noise floor is taken from the air cuts."
    if tracing.dataset.tool.kind == "drill":
        return "There is no air cut: the noise floor is what is alike at all frequencies of a hole."
    if tracing.dataset.sensor.noise_std_n is not None:
        return "The noise floor is the sensor's stated noise, within the band."
    return (
        "There is no air cut and no stated sensor noise: the noise floor is what lies between the lines of "
        "the spindle, and may hold vibration as well as noise."
    )


def _has_air(tracing: Tracing) -> bool:
    return any(trial.kind == "air" for trial in tracing.dataset.trials)


def _words(name: str) -> str:
    return name.replace("_", " ")
