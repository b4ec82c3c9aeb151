"""The five sheets of the paper and the ranges their mechanistic constants are drawn from.

No mechanistic constants for these sheets with a slitting saw are published. The chip constants of aluminium
span the published end-mill values of 6082, 6061 and 7075 (Chinese J. Mech. Eng. 2021, table 5, doi
10.1186/s10033-021-00536-9: K_tc 244 to 1319 N/mm^2). All else is our judgement: ranges for which the fixed
baseline (12.5 mm/s, 1 mm, 4 N/mm) comes out near the load and the removed volume that Hathaway et al. (IROS
2024) print for it. At those depths the chip force is a few per cent of the load, so "edge" here stands for
edge, rubbing and blade friction together. K_re / K_te is lower than published edge ratios (.5 to 1): a
compliant arm yields to the feed force in depth too (off-diagonal mobility), which lifts the saw as a
radial force does.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Range:
    """Where the constants of one sheet lie.

    Fields:
        K_tc_n_mm2: tangential chip constant, N/mm^2, log-uniform.
        K_te_n_mm: tangential edge constant, N/mm, log-uniform.
        edge_ratio: K_re / K_te, log-uniform (drawn as a ratio: drawn apart, some pairs pull the saw in).
        chip_ratio: K_rc / K_tc, uniform.
        thickness_m: thickness of the sheet, m.
    """

    K_tc_n_mm2: tuple[float, float]
    K_te_n_mm: tuple[float, float]
    edge_ratio: tuple[float, float]
    chip_ratio: tuple[float, float] = (0.1, 0.6)
    thickness_m: float = 0.005


MATERIALS: dict[str, Range] = {
    "foam": Range((1.0, 10.0), (5.0, 10.0), (0.04, 0.09), thickness_m=0.020),
    "plastic": Range((20.0, 80.0), (4.5, 9.0), (0.5, 1.0)),
    "cardboard": Range((10.0, 60.0), (8.0, 16.0), (0.06, 0.13)),
    "mica": Range((50.0, 300.0), (38.0, 76.0), (0.11, 0.22)),
    "aluminium": Range((240.0, 1320.0), (28.0, 56.0), (0.11, 0.22)),
}
"""Ranges by name, in the order of the paper's tables."""

PAPER_BASELINE: dict[str, tuple[float, float, float, float]] = {
    "foam": (19.4, 2.29, 9.03, 331.0),
    "plastic": (20.1, 2.29, 5.57, 72.4),
    "cardboard": (20.1, 2.38, 12.1, 207.0),
    "mica": (19.8, 3.67, 14.1, 10.0),
    "aluminium": (20.1, 3.21, 14.0, 17.7),
}
"""The paper's baseline on the real robot: time s, path deviation mm, load N, removed volume mm^3."""
