"""A filter before sampling that nobody declared: most acquisition hardware has one near half its rate.

Without a filter what the teeth do beyond half the sampling rate folds into the records, and every model of
the lines folds it alike. Behind a steep filter, as that of a converter which samples faster and decimates,
nothing is there to fold: models then have what the records lack, and a low-pass of the sensor would be named
for it. The base model tells which of the two a session is, where it has such lines at all.
"""

from __future__ import annotations

from dataclasses import replace

from numpy.typing import NDArray

from mjx_cutting.tracing.fitting.fit import fit_base
from mjx_cutting.tracing.fitting.problem import pose
from mjx_cutting.tracing.records.followed_angle import as_followed
from mjx_cutting.tracing.records.levels import LEVEL_KINDS
from mjx_cutting.tracing.records.lines import compress, trusted_band
from mjx_cutting.tracing.records.spindle import as_turned
from mjx_cutting.trials.dataset import AntiAlias, Dataset

_CORNERS = (0.44, 0.48, 0.4)
_STEEP = 8
_PASSES = 0.75
_CLEARLY_LESS = 0.85


Band = tuple[float, float]


def as_filtered(dataset: Dataset, band_hz: Band | None) -> tuple[Dataset, Band | None, tuple[str, ...]]:
    """The data set, of a cutter whose records clearly lack what would fold into them, with the filter that
    they seem to stand behind; the band that was asked for, else up to where it surely passes; and what is to
    be told (call it in float64)."""
    if dataset.sensor.anti_alias is not None or dataset.tool.kind in LEVEL_KINDS:
        return dataset, band_hz, ()
    turned, rate_hz = as_followed(as_turned(dataset)), dataset.sensor.sample_rate_hz
    band = trusted_band(dataset, band_hz)
    lines = compress(turned, band)
    if lines.orders * lines.speed_rev_s.max() < 0.5 * rate_hz:
        return dataset, band_hz, ()
    about, least = lines.speed_rev_s, _CLEARLY_LESS * _left(turned, band, lines.speed_rev_s)
    found = None
    for corner in _CORNERS:
        alias = AntiAlias(order=_STEEP, hz=corner * rate_hz, zero_phase=True)
        left = _left(_behind(turned, alias), band, about)
        if left < least:
            found, least = alias, left
        elif found is None:
            break
    if found is None:
        return dataset, band_hz, ()
    passed = (0.0, _PASSES * found.hz) if band_hz is None else band_hz
    said = (
        f"no filter before sampling is declared, and what the teeth do above half the sampling rate is not "
        f"in the records: they were read as if behind a steep filter at {found.hz:.0f} Hz; declare the one "
        "that the acquisition has (sensor.anti_alias)"
    )
    return _behind(dataset, found), passed, (said,)


def _behind(dataset: Dataset, alias: AntiAlias) -> Dataset:
    return replace(dataset, sensor=replace(dataset.sensor, anti_alias=alias))


def _left(dataset: Dataset, band_hz: Band, about_rev_s: NDArray) -> float:
    """Squared error that the base model leaves, as a share of the force's energy."""
    lines = compress(dataset, band_hz, about_rev_s)
    _, base = fit_base(pose(dataset, lines))
    return float((base.error_n2.sum() + lines.rest_n2.sum()) / lines.energy_n2.sum())
