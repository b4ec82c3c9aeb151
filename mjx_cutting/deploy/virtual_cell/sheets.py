"""The five sheets as the virtual cell has them: one true set of mechanistic constants each.

Not those of the training simulation, which draws from ranges: these are single values, chosen once inside
what is plausible (aluminium: end-mill values of 6082 to 7075, Chinese J. Mech. Eng. 2021, doi
10.1186/s10033-021-00536-9, table 5; the others: so that 1 mm at 12.5 mm/s loads a 4 N/mm arm about as much
as Hathaway et al., IROS 2024, print). "Edge" stands for edge, rubbing and blade friction together.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Constants:
    """What a sheet resists with.

    Fields: `chip_n_m2` tangential, radial, axial, force per width and chip thickness; `edge_n_m` the same
    per width; `thickness_m` of the sheet.
    """

    chip_n_m2: tuple[float, float, float]
    edge_n_m: tuple[float, float, float]
    thickness_m: float


SHEETS = {
    "foam": Constants((4.0e6, 1.2e6, 0.0), (7.5e3, 0.45e3, 0.0), 0.020),
    "plastic": Constants((45.0e6, 16.0e6, 0.0), (6.0e3, 4.0e3, 0.0), 0.005),
    "cardboard": Constants((28.0e6, 8.0e6, 0.0), (11.0e3, 1.0e3, 0.0), 0.005),
    "mica": Constants((140.0e6, 45.0e6, 0.0), (52.0e3, 8.0e3, 0.0), 0.005),
    "aluminium": Constants((640.0e6, 100.0e6, 0.0), (40.0e3, 6.5e3, 0.0), 0.005),
}


def constants(name: str) -> Constants:
    """The constants of a sheet.

    Raises:
        ValueError: no such sheet.
    """
    if name not in SHEETS:
        raise ValueError(f"got the material {name!r}; expected one of {', '.join(SHEETS)}")
    return SHEETS[name]
