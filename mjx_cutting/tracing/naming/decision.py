"""When an effect may be named: tests that a candidate must pass, each with its figure.

1. chance: the drop in the weighted squared error, as an F test with as many tries as there are candidates
   and starts (Bonferroni). A coherent model error of `TOLERANCE` of the force counts as noise, because no
   simulator's own discretisation is finer and a chi-square alone names an effect in clean data.
2. held out: the error on unseen trials falls by at least `LEAST_GAIN` of itself, by `TOLERANCE` of the force
   (root mean square; less where the model's force hardly is) and by two standard errors over trials (of
   fewer than five by as many as a t of their freedom asks), or in shares of what each trial leaves by more
   than chance does; and no axis pays for it.
3. interval: the strength's interval excludes the value at which the effect vanishes, and a resonance is known
   to an octave.
4. range: every parameter lies inside its physical range, not at the edge of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mjx_cutting.cutting import AbstractEffect
from mjx_cutting.cutting.effects import Parameter
from mjx_cutting.tracing.fitting.heldout import HeldOut
from mjx_cutting.tracing.fitting.problem import TOLERANCE
from mjx_cutting.tracing.naming.chance import CHANCE, STANDARD_ERRORS, chance_over_trials, gain_over_trials
from mjx_cutting.tracing.naming.intervals import Interval, quantile

LEAST_GAIN = 0.02
_EDGE = 0.01
_BENEATH = 0.1
_RISES = 0.25
_MOST_TRIALS = 0.75
_SHARP = 2.0
_FEW_TRIALS = 5


@dataclass(frozen=True)
class Decision:
    """Whether a candidate is accepted; `reasons` says why not, one entry a failed test.

    `physical` is False where it explains what it does only with a parameter at the edge of its range;
    `untold` is True where all that failed is what would tell it from another effect, or that a frequency is
    not known to a factor of two, `scattered` where it is that the gain differs much from trial to trial,
    `unsure` where it is that or chance; `guarded` where it passed every test and a guard refused it.
    """

    accepted: bool
    physical: bool
    p_chance: float
    gain: float
    gain_standard_error: float
    parameters: dict[str, Interval]
    reasons: tuple[str, ...]
    untold: bool = False
    scattered: bool = False
    unsure: bool = False
    guarded: bool = False


def decide(
    kind: type[AbstractEffect],
    before: HeldOut,
    after: HeldOut,
    p_chance: float,
    parameters: dict[str, Interval],
    over_trials: bool = True,
    tolerance: float = TOLERANCE,
    in_range: bool = True,
    axes: Sequence[str] = ("x", "y", "z"),
) -> Decision:
    """Apply the four tests; `over_trials` False leaves out that of the gain's standard error over trials,
    `in_range` False that of the range, of which `physical` then tells; `tolerance` is the share of the force
    that a model's own calculation may be off; `axes` names what was measured."""
    gain, error = gain_over_trials(before, after)
    asked = _errors_asked(len(before.energy_n2))
    within = gain < asked * error and chance_over_trials(before, after, 1) > CHANCE
    reasons, scattered = [], False
    if by_chance := p_chance > CHANCE:
        reasons.append(
            f"chance alone gives the best candidate as much (p = {p_chance:.2g}, limit {CHANCE:g})"
        )
    if gain < LEAST_GAIN * before.nrmse:
        reasons.append(
            f"error on held-out trials goes from {before.nrmse:.4f} to {after.nrmse:.4f}; "
            f"a fall of at least {LEAST_GAIN:.0%} is asked"
        )
    elif _accounted(before, after) < tolerance:
        reasons.append(
            f"accounts for {_accounted(before, after):.2%} of the force, less than the {tolerance:.1%} "
            "that any model's own calculation may be off"
        )
    elif scattered := over_trials and within:
        reasons.append(f"gain {gain:.4f} is within {asked:.3g} standard errors ({error:.4f}) over the trials")
    if not scattered and (axis := _paid_by(before, after, tolerance)) is not None:
        reasons.append(
            f"predicts {axes[axis]} worse on held-out trials ({before.per_axis[axis]:.4f} to "
            f"{after.per_axis[axis]:.4f} of what it measures) to have the others better"
        )
    nil = _no_effect(kind, parameters)
    reasons += nil.values()
    blurred = [why for name in kind.sharp if (why := _blurred(name, parameters[name]))]
    reasons += blurred
    beyond = {}
    for name, each in parameters.items():
        declared = kind.parameters[name]
        if declared.identity is None and declared.typical == 0.0:
            continue
        if _at_edge(each.value, declared):
            beyond[name] = (
                f"{name} runs to {each.value:.3g}{_in(each.unit)}, the edge of its physical range "
                f"{declared.low:g} to {declared.high:g}"
            )
    reasons += beyond.values() if in_range else []
    # of a mode that may be anywhere it says nothing to what edge its damping runs
    left_open = len(nil) + len(blurred) + (len(beyond) if blurred and in_range else 0)
    strong = kind.strength not in {*nil, *beyond}
    untold = bool(nil or blurred) and strong and len(reasons) == left_open
    unsure = bool(reasons) and len(reasons) == by_chance + scattered
    scattered = scattered and len(reasons) == 1
    return Decision(
        not reasons, not beyond, p_chance, gain, error, parameters, tuple(reasons), untold, scattered, unsure
    )


def _errors_asked(trials: int) -> float:
    """By how many standard errors over so many trials a gain must be more than none: of three or four they
    are known too badly themselves."""
    return STANDARD_ERRORS if trials >= _FEW_TRIALS else quantile(trials)


def _paid_by(before: HeldOut, after: HeldOut, tolerance: float) -> int | None:
    """The axis that an effect which is not there lets go wrong, to fit another: its squared error rises by a
    quarter or more, in most of the trials, and by more than the model may be off."""
    rise = after.error_n2 - before.error_n2
    whole = rise.sum(axis=0)
    most = np.mean(rise > 0.0, axis=0) >= _MOST_TRIALS
    enough = np.maximum(_RISES * before.error_n2.sum(axis=0), tolerance**2 * before.energy_n2.sum())
    paid = np.flatnonzero(most & (whole > enough))
    return int(paid[0]) if paid.size else None


def _no_effect(kind: type[AbstractEffect], parameters: dict[str, Interval]) -> dict[str, str]:
    """In words, by name: that the strength may be that of no effect, or all of the telling parameters may."""
    nil = {
        name: why for name in (kind.strength, *kind.telling) if (why := _nil(kind, name, parameters[name]))
    }
    if not all(name in nil for name in kind.telling):
        return {name: why for name, why in nil.items() if name == kind.strength}
    return nil


def _nil(kind: type[AbstractEffect], name: str, found: Interval) -> str | None:
    """In words, that an interval holds the value of no effect; None where it does not."""
    identity = kind.parameters[name].identity
    if identity is None or not found.low <= identity <= found.high:
        return None
    return f"{name} {found.low:.3g} to {found.high:.3g}{_in(found.unit)} includes {identity:g}, no effect"


def _blurred(name: str, found: Interval) -> str | None:
    """In words, that a parameter is not known to a factor of two; None where it is."""
    if found.low > 0.0 and found.high <= _SHARP * found.low:
        return None
    lies = f"{name} {found.low:.3g} to {found.high:.3g}{_in(found.unit)}"
    return f"{lies} is not known to a factor of {_SHARP:g}"


def _at_edge(value: float, declared: Parameter) -> bool:
    """Whether a value lies at an end of its range, or beyond; one where the effect vanishes is no edge."""
    low, high = declared.low, declared.high
    if declared.log and low > 0.0:
        low, high, value = np.log(low), np.log(high), np.log(max(value, 1e-300))
    margin = _EDGE * (high - low)
    vanishes = declared.identity is not None and declared.identity == declared.low
    beneath = min(margin, _BENEATH * declared.typical) if vanishes else -margin
    return bool(value > high - margin or value < low - beneath)


def _accounted(before: HeldOut, after: HeldOut) -> float:
    """Root-mean-square of what the candidate explains on held-out trials, over that of the force."""
    return float(np.sqrt(max(before.nrmse**2 - after.nrmse**2, 0.0)))


def _in(unit: str) -> str:
    """The unit behind a number; nothing behind a bare one."""
    return "" if unit == "1" else f" {unit}"
