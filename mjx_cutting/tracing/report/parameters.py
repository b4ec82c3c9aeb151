"""Parameters of the final model with 95 % intervals: the effects' own, and the mechanistic constants.

Intervals are delete-group jackknife over the folds, as `decision.interval` makes them for the effects: the
spread of the fits with one fold left out, times Student's t. With few folds they are wide, and rightly so.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mjx_cutting._report.quantities import interval, joined
from mjx_cutting.tracing.naming.intervals import half_width
from mjx_cutting.tracing.told import Tracing

_CONSTANTS = (
    ("K_tc_n_m2", "K_tc", "tangential force per chip area", "N/m^2"),
    ("K_rc_n_m2", "K_rc", "radial force per chip area", "N/m^2"),
    ("K_ac_n_m2", "K_ac", "axial force per chip area", "N/m^2"),
    ("K_te_n_m", "K_te", "tangential edge force per width", "N/m"),
    ("K_re_n_m", "K_re", "radial edge force per width", "N/m"),
    ("K_ae_n_m", "K_ae", "axial edge force per width", "N/m"),
)


@dataclass(frozen=True, eq=False)
class Estimate:
    """One parameter.

    Fields:
        label, meaning: name for figures and tables, what it is.
        effect: name of the effect it belongs to, "" for a constant of the base model.
        value, low, high: SI; `by_fold` [F] the values with a fold left out; `unit` SI.
        base: value in the base model without effects, or None for a parameter of an effect.
        strength: True for the parameter that is an effect's size.
        whole: True for a whole number, which has no interval.
    """

    label: str
    meaning: str
    effect: str
    value: float
    low: float
    high: float
    by_fold: NDArray[np.float64]
    unit: str
    base: float | None = None
    strength: bool = False
    whole: bool = False

    @property
    def held(self) -> bool:
        """True where the fit did not move it: these trials cannot determine it."""
        return self.low == self.high == self.value and not self.whole

    @property
    def text(self) -> str:
        """Value with its unit."""
        value, _, symbol = interval(self.value, self.low, self.high, self.unit)
        return joined(value, symbol)


def estimates(tracing: Tracing) -> list[Estimate]:
    """Returns the effects' parameters in order of acceptance, then the mechanistic constants."""
    search = tracing.search
    assert search.final.fits is not None
    by_fold, found = search.final.fits.model, []
    for index, (kind, intervals) in enumerate(zip(search.effects, search.intervals, strict=True)):
        again = sum(each is kind for each in search.effects[:index])
        label = kind.name.replace("_", " ") + (f" {again + 1}" if again else "")
        for name, said in intervals.items():
            declared = kind.parameters[name]
            if declared.identity is None and (said.low, said.high) == (declared.low, declared.high):
                continue  # unknown
            values = np.asarray(getattr(by_fold.effects[index], name), dtype=float)
            if values.ndim > 1:
                tooth = int(
                    np.argmax(np.abs(np.asarray(getattr(search.final_fit.model.effects[index], name))))
                )
                values = values[:, tooth]
            found.append(
                Estimate(
                    label=f"{label}: {name}",
                    meaning=_where(declared.per_tooth),
                    effect=kind.name,
                    value=said.value,
                    low=said.low if np.isfinite(said.low) else said.value,
                    high=said.high if np.isfinite(said.high) else said.value,
                    by_fold=values[np.isfinite(values)],
                    unit=said.unit,
                    strength=name == kind.strength,
                    whole=declared.whole,
                )
            )
    base, final = tracing.base_model.material, tracing.model.material
    for field, label, meaning, unit in _CONSTANTS:
        value, values = float(np.asarray(getattr(final, field))), np.asarray(getattr(by_fold.material, field))
        half = float(half_width(values))
        found.append(
            Estimate(
                label=label,
                meaning=meaning,
                effect="",
                value=value,
                low=value - half,
                high=value + half,
                by_fold=values,
                unit=unit,
                base=float(np.asarray(getattr(base, field))),
            )
        )
    return found


def _where(per_tooth: bool) -> str:
    return "of the tooth that differs most" if per_tooth else ""
