"""What a residual still depends on: tests of independence against every covariate at hand.

A simulator's residual need not be white, but it must not depend on what the simulator knows. Within a trial
the residual is tested for lines at spindle orders (tooth passing apart), for drift along the trial, for
memory and for a tie between axes; across trials its size, and the factor by which the force is larger than
predicted, are tested against feed, speed, depth, cut length and clock time by Spearman's rank correlation
with permutations, because trials, not samples, are the independent units; by the clock the factor may also
come and go, as a slow curve. A factor that goes with none of them is the trial's own, and lines at tooth
passing and ties between axes are looked for without it. A factor that all trials share at the same place is
told from one that changes with time. `share` is the part of the residual's energy that goes with the
covariate; each trial's mean counts only across trials.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.linalg import pinvh

from mjx_cutting.tracing.fitting.prediction import Prediction, energy
from mjx_cutting.tracing.fitting.problem import TOLERANCE
from mjx_cutting.tracing.records.course import along_path
from mjx_cutting.tracing.records.levels import LEVEL_KINDS
from mjx_cutting.tracing.records.lines import basis, order_of_columns
from mjx_cutting.tracing.telling.judged import in_shares
from mjx_cutting.tracing.telling.momentary import Momentary, momentary
from mjx_cutting.tracing.telling.over_trials import curved, ranked, straight
from mjx_cutting.tracing.telling.own_factor import OwnFactors, own_factors
from mjx_cutting.tracing.telling.repeats import MOST_ORDERS, orders_heard, turned
from mjx_cutting.trials.dataset import Dataset

Array = NDArray[np.floating]
SIGNIFICANT = 0.001
NOTICEABLE = 0.02
_SLOW_TERMS = 6
_RIDGE = 1e-9
_ALIKE = 0.02
_SHARE_OF_OWN = 0.5
_TESTED_OF_ALL = 3
_TOLD = 3
_MOST_OF_IT = 0.9


@dataclass(frozen=True)
class Dependence:
    """What a residual does with one covariate.

    Fields: `p_value` of chance; `share` of the residual energy that goes with the covariate; `of_force`, the
    same as a root mean square over that of the force; `look_for`, in words; of a factor of each trial's own,
    `factor` its root mean square.
    """

    covariate: str
    p_value: float
    share: float
    of_force: float
    look_for: str
    factor: float = 0.0

    @property
    def found(self) -> bool:
        """True where it is beyond chance, and more than any model's own calculation may be off."""
        return self.p_value < SIGNIFICANT and self.share > NOTICEABLE and self.of_force > TOLERANCE


_LOOK_FOR = {
    "spindle order": "something that repeats once per revolution: runout, pitch, a damaged tooth, unbalance",
    "tooth phase": "the force under a tooth: edge law, engagement, a filter or resonance on tooth passing",
    "time in trial": "drift or change along the path: entry and exit, wear, heating, a layered sheet",
    "position": "force larger or smaller at the same place in every trial: the sheet, its clamping, the pose",
    "feed": "an edge law that is not linear in chip thickness",
    "spindle speed": "a response in Hz (structure, sensor) or a law that depends on cutting speed",
    "feed with spindle speed": "a law in which the two act together: heat, rate of strain",
    "radial depth": "compliance, friction on the engaged area, clogging",
    "cut length": "flank wear",
    "clock time": "thermal drift of the sensor",
    "trial": "a force larger or smaller as a whole: sheets that are not alike, a gain that does not repeat",
    "previous force": "memory or a line at a fixed frequency: a mode of the structure, mains pickup, chatter",
    "another axis": "crosstalk of the sensor or forces turned between the axes",
}
_ALL_OF_THE_FORCE = (
    "all of the force, on every axis alike, larger and smaller from turn to turn: the sheet, lubrication, "
    "chips that stay, an uneven feed or the sensor's gain, not a force beside that of the cut"
)
_COMES_AND_GOES = (
    "a force larger or smaller as a whole that comes and goes over several trials: the temperature of the "
    "sheet, the machine or the room, coolant, supply pressure or voltage"
)


_AS_THE_FORCE = (
    "every axis in the proportions of the cut's force: what the tool meets varies (depth, feed, the "
    "material), or the sensor's gain does, not a force beside that of the cut"
)
_OF_TURNS = (
    "something that repeats with the turns of the spindle, most of it {} a turn: a workpiece out of round, "
    "the jaws of a chuck, runout, lips that are not alike"
)


def dependences(
    dataset: Dataset, predictions: Sequence[Prediction], teeth: int, orders: int
) -> tuple[Dependence, ...]:
    """All tests on the residuals of a dataset's cut trials, the strongest first."""
    predictions = in_shares(predictions) if dataset.tool.kind == "drill" else predictions
    band = _independent_share(dataset, predictions)
    own = own_factors(predictions)
    # of a tool that is always engaged a trial has one level: without its factor nothing of that is left
    levels, ways = dataset.tool.kind in LEVEL_KINDS, 0.0
    shaped: Sequence[Prediction] = own.without
    if levels:
        # nor has it a tooth passing
        orders, teeth = orders_heard(predictions), MOST_ORDERS + 1
        shaped, ways = turned(predictions, orders)
    split = [_split(each, orders) for each in shaped]
    periodic = _periodic(split, teeth, orders, band, ways)
    if levels and orders:
        turns = _OF_TURNS.format(_times_a_turn(split, orders))
        periodic = [replace(each, look_for=turns) for each in periodic]
    moves = None if levels else momentary(predictions, band)
    tied = shaped if moves is None else own_factors(moves.without).without
    axes = _axes(tied, band)
    if levels and _as_the_force(tied) > _MOST_OF_IT:
        axes = replace(axes, look_for=_AS_THE_FORCE)
    along = _slow(predictions, band) if moves is None else _moving(moves, predictions, band)
    whole, force = (
        max(energy(each), 1e-300)
        for each in ([p.residual_n for p in predictions], [p.measured_n for p in predictions])
    )
    found = [
        replace(each, share=energy(_centred(seen)) / whole * each.share)
        for tests, seen in (
            ([*periodic, _memory(split, band)], shaped),
            ([axes], tied),
            ([along, _place(dataset, predictions, band)], predictions),
        )
        for each in tests
    ]
    across = _across(dataset, predictions, own)
    found += [*across, _own(own, predictions, band, across)]
    told = [replace(each, of_force=float(np.sqrt(each.share * whole / force))) for each in found]
    return tuple(sorted(told, key=lambda each: (each.p_value, -each.share)))


def _entry(covariate: str, p_value: float, share: float) -> Dependence:
    return Dependence(covariate, float(p_value), float(np.clip(share, 0.0, 1.0)), 0.0, _LOOK_FOR[covariate])


def _centred(predictions: Sequence[Prediction]) -> list[Array]:
    """[T, 3] of each trial: what is left beside its mean."""
    return [each.residual_n - each.residual_n.mean(axis=0) for each in predictions]


def _independent_share(dataset: Dataset, predictions: Sequence[Prediction]) -> float:
    """Independent samples per sample: a band-limited record has 2 B of them a second."""
    energy = np.mean(
        [np.abs(np.fft.rfft(p.residual_n - p.residual_n.mean(axis=0), axis=0)) ** 2 for p in predictions[:1]],
        axis=0,
    )
    spectrum = energy.sum(axis=1)
    return float(np.clip(np.mean(spectrum > 1e-9 * spectrum.max()), 1e-3, 1.0))


class _Split(NamedTuple):
    """A residual without its mean: `left` [T, 3], its lines' coefficients on `columns` [T, 2 orders] and what
    lies between the lines, `rest` [T, 3]."""

    left: Array
    columns: Array
    weights: Array
    rest: Array


def _split(prediction: Prediction, orders: int) -> _Split:
    left = prediction.residual_n - prediction.residual_n.mean(axis=0)
    columns = basis(prediction.angle_rad, orders)[:, 1:]
    # two orders that aliasing puts at one frequency share the line there: what is between them is not told;
    # pinvh, since the divide and conquer behind numpy's may fail next to a multiple of the identity
    weights = pinvh(columns.T @ columns, rtol=_ALIKE) @ columns.T @ left
    return _Split(left, columns, weights, left - columns @ weights)


def _periodic(split: Sequence[_Split], teeth: int, orders: int, band: float, ways: float) -> list[Dependence]:
    """Lines at multiples of tooth passing, and at the other spindle orders, against what lies between; `ways`
    as `turned` gives them."""
    order = order_of_columns(orders)[1:]
    passing = (order % teeth) == 0
    energy, line, count = np.zeros(2), np.zeros(2), np.zeros(2)
    whole, freedom = 0.0, 0.0
    for left, columns, weights, rest in split:
        line += [np.sum((columns[:, mask] @ weights[mask]) ** 2) for mask in (passing, ~passing)]
        count += 3 * np.array([passing.sum(), (~passing).sum()])
        energy += np.sum(rest**2)
        whole += float(np.sum(left**2))
        freedom += max(3 * (band * len(left) - columns.shape[1]), 1.0)
    results = []
    for index, name in enumerate(("tooth phase", "spindle order")):
        if count[index] == 0 or whole == 0:
            continue
        statistic = (line[index] / count[index]) / max(energy[index] / freedom, 1e-300)
        p_value = np.exp(min(stats.f.logsf(statistic, count[index], freedom) + ways, 0.0))
        results.append(_entry(name, p_value, line[index] / whole))
    return results


def _times_a_turn(split: Sequence[_Split], orders: int) -> str:
    """How often most of what repeats with the turns does so in one of them, in words."""
    order = order_of_columns(orders)[1:]
    lines = [
        sum(
            float(np.sum((columns[:, order == n] @ weights[order == n]) ** 2))
            for _, columns, weights, _ in split
        )
        for n in range(1, orders + 1)
    ]
    most = 1 + int(np.argmax(lines))
    return "once" if most == 1 else f"{most} times"


def _slow(predictions: Sequence[Prediction], band: float) -> Dependence:
    """A slow curve along each trial: the mean and the size of the residual against time."""
    line, whole, between, freedom, count = 0.0, 0.0, 0.0, 0.0, 0
    for each, left in zip(predictions, _centred(predictions), strict=True):
        u = 2.0 * (each.time_s - each.time_s[0]) / (each.time_s[-1] - each.time_s[0]) - 1.0
        columns = np.polynomial.chebyshev.chebvander(u, _SLOW_TERMS)[:, 1:]
        weights, *_ = np.linalg.lstsq(columns, left, rcond=None)
        explained = float(np.sum((columns @ weights) ** 2))
        line, whole = line + explained, whole + float(np.sum(left**2))
        between += float(np.sum(left**2)) - explained
        freedom += 3 * max(band * len(left) - _SLOW_TERMS, 1.0)
        count += 3 * _SLOW_TERMS
    statistic = (line / count) / max(between / freedom, 1e-300)
    return _entry("time in trial", stats.f.sf(statistic, count, freedom), line / max(whole, 1e-300))


def _moving(moves: Momentary, predictions: Sequence[Prediction], band: float) -> Dependence:
    """A factor on all of the force that changes along each trial."""
    freedom = sum(3 * band * len(each.time_s) for each in predictions) - moves.free
    statistic = (moves.share / moves.free) / max((1.0 - moves.share) / max(freedom, 1.0), 1e-300)
    told = _entry("time in trial", stats.f.sf(statistic, moves.free, max(freedom, 1.0)), moves.share)
    return replace(told, look_for=_ALL_OF_THE_FORCE)


def _place(dataset: Dataset, predictions: Sequence[Prediction], band: float) -> Dependence:
    """A factor on the force that changes with the place along the path, the same in every trial; unless one
    that changes with time does as much, or a curve of each trial's own does far more."""
    trials = {trial.file: trial for trial in dataset.trials}
    places = [along_path(trials[each.file]) for each in predictions]
    times = [each.time_s - each.time_s[0] for each in predictions]
    left = _centred(predictions)
    whole = energy(left)
    common, own = _factor_along(places, predictions, left)
    in_time, _ = _factor_along(times, predictions, left)
    freedom = sum(3 * max(band * len(each) - _SLOW_TERMS, 1.0) for each in left)
    statistic = (common / _SLOW_TERMS) / max((whole - common) / freedom, 1e-300)
    told = common > max(in_time, _SHARE_OF_OWN * own)
    return _entry(
        "position", stats.f.sf(statistic, _SLOW_TERMS, freedom) if told else 1.0, common / max(whole, 1e-300)
    )


def _factor_along(
    ways: Sequence[Array], predictions: Sequence[Prediction], left: Sequence[Array]
) -> tuple[float, float]:
    """Energy that a slow factor along the ways takes away: one curve for all trials, one for each."""
    low, high = min(float(way.min()) for way in ways), max(float(way.max()) for way in ways)
    square, product, own = np.zeros((_SLOW_TERMS, _SLOW_TERMS)), np.zeros(_SLOW_TERMS), 0.0
    for way, each, rest in zip(ways, predictions, left, strict=True):
        u = 2.0 * (way - low) / max(high - low, 1e-12) - 1.0
        curve = np.polynomial.chebyshev.chebvander(u, _SLOW_TERMS)[:, 1:]
        columns = (each.predicted_n - each.bias_n)[..., None] * curve[:, None, :]
        columns = (columns - columns.mean(axis=0)).reshape(-1, _SLOW_TERMS)
        gram, toward = columns.T @ columns, columns.T @ rest.ravel()
        square, product = square + gram, product + toward
        own += float(toward @ pinvh(gram, rtol=_RIDGE) @ toward)
    return float(product @ pinvh(square, rtol=_RIDGE) @ product), own


def _memory(split: Sequence[_Split], band: float) -> Dependence:
    """Correlation, about one independent sample apart, of what lies between the spindle's lines.

    It is counted from that of white noise in the same band.
    """
    lag = max(1, round(1.0 / band))
    product, between, whole, count, expected = 0.0, 0.0, 0.0, 0, 0.0
    for left, _, _, rest in split:
        product += float(np.sum(rest[lag:] * rest[:-lag]))
        between += float(np.sum(rest**2))
        whole += float(np.sum(left**2))
        count += int(3 * band * len(left))
        expected += _of_white_noise(left, lag) * float(np.sum(rest**2))
    correlation = (product - expected) / max(between, 1e-300)
    share = correlation**2 * between / max(whole, 1e-300)
    return _entry("previous force", 2.0 * stats.norm.sf(abs(correlation) * np.sqrt(count)), share)


def _of_white_noise(record: Array, lag: int) -> float:
    """Correlation of white noise at `lag` samples, in the band that the record occupies."""
    spectrum = np.sum(np.abs(np.fft.rfft(record, axis=0)) ** 2, axis=1)
    heard = spectrum > 1e-9 * spectrum.max()
    turn = 2.0 * np.pi * lag * np.arange(len(spectrum)) / len(record)
    return float(np.sum(heard * np.cos(turn)) / np.sum(heard))


def _axes(predictions: Sequence[Prediction], band: float) -> Dependence:
    """Largest correlation between the residuals of two axes."""
    left = np.concatenate(_centred(predictions))
    scale = np.sqrt(np.maximum(np.sum(left**2, axis=0), 1e-300))
    correlation = (left.T @ left) / np.outer(scale, scale)
    strongest = float(np.max(np.abs(correlation - np.diag(np.diag(correlation)))))
    p_value = min(1.0, 3.0 * 2.0 * stats.norm.sf(strongest * np.sqrt(band * len(left))))
    return _entry("another axis", p_value, strongest**2)


def _as_the_force(predictions: Sequence[Prediction]) -> float:
    """Share of what is left, beside each trial's mean, that every axis has as the trial's predicted force."""
    along, whole = 0.0, 0.0
    for each, left in zip(predictions, _centred(predictions), strict=True):
        force = (each.predicted_n - each.bias_n).mean(axis=0)
        along += float(np.sum((left @ force) ** 2)) / max(float(force @ force), 1e-300)
        whole += float(np.sum(left**2))
    return along / max(whole, 1e-300)


def _own(
    own: OwnFactors, predictions: Sequence[Prediction], band: float, across: Sequence[Dependence]
) -> Dependence:
    """A factor of each trial's own, against what is left without it; unless a condition tells most of it."""
    by_condition = [each.share for each in across if each.p_value < SIGNIFICANT]
    freedom = sum(3 * band * len(each.time_s) for each in predictions)
    statistic = (own.share / len(own.factor)) / max((1.0 - own.share) / freedom, 1e-300)
    p_value = stats.f.sf(statistic, len(own.factor), freedom)
    p_value = 1.0 if max(by_condition, default=0.0) > _SHARE_OF_OWN * own.share else p_value
    entry, most = _entry("trial", p_value, own.share), np.argsort(-np.abs(own.factor))[:_TOLD]
    told = ", ".join(f"{predictions[each].file} {own.factor[each]:+.0%}" for each in most)
    return replace(entry, factor=own.size, look_for=f"{entry.look_for}; most in {told}")


def _across(dataset: Dataset, predictions: Sequence[Prediction], own: OwnFactors) -> list[Dependence]:
    """Size of each trial's residual, its level, and the factor by which its force is off, against the trial's
    conditions; what all trials share goes with none."""
    trials = {trial.file: trial for trial in dataset.trials}
    size = np.array([float(np.mean(each.residual_n**2)) for each in predictions])
    varies = 1.0 - float(size.min()) / max(float(size.mean()), 1e-300)
    factor, factored = own.factor, own.share
    levels = np.stack([each.residual_n.mean(axis=0) for each in predictions])
    levelled = [len(each.time_s) * level**2 for each, level in zip(predictions, levels, strict=True)]
    on_axis = np.sum(levelled, axis=0) / max(energy([p.residual_n for p in predictions]), 1e-300)
    covariates = {
        "feed": [trials[p.file].feed_speed_m_s for p in predictions],
        "spindle speed": [trials[p.file].spindle_speed_rev_s for p in predictions],
        "radial depth": [trials[p.file].radial_depth_m for p in predictions],
        "cut length": [trials[p.file].cut_length_before_m for p in predictions],
        "clock time": [trials[p.file].clock_start_s for p in predictions],
    }
    results = []
    for name, values in covariates.items():
        if len(set(values)) < 3 or len(size) < 4 or np.ptp(size) == 0.0:
            continue
        at = np.asarray(values)
        tests = [ranked(at, size, varies), straight(at, factor, factored)]
        by_axis = [straight(at, *axis) for axis in zip(levels.T, on_axis, strict=True)]
        tests.append((len(by_axis) * min(by_axis)[0], sum(share for _, share in by_axis)))
        if name == "clock time":
            tests.append(curved(at, factor, factored))
        best = int(np.argmin([p_value for p_value, _ in tests]))
        told = _entry(name, min(1.0, len(tests) * tests[best][0]), tests[best][1])
        results.append(told if best < _TESTED_OF_ALL else replace(told, look_for=_COMES_AND_GOES))
    feed, speed = (stats.rankdata(covariates[name]) for name in ("feed", "spindle speed"))
    together = (feed - feed.mean()) * (speed - speed.mean())
    if len(set(feed)) > 2 and len(set(speed)) > 2 and len(factor) > 5:
        results.append(_entry("feed with spindle speed", *straight(together, factor, factored)))
    return results
