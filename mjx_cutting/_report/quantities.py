"""Numbers as people read them: rounded to what is known, in workshop units, never NaN.

Inside the package everything is SI; a report shows micrometres, millimetres a minute, newtons per square
millimetre. What is missing or not finite is shown as a dash.
"""

from __future__ import annotations

import math

DASH = "–"
NO_BREAK = "\u00a0"
_SCALES: dict[str, tuple[tuple[float, float, str], ...]] = {
    # SI unit: (smallest magnitude, factor, symbol), largest first
    "m": ((1.0, 1.0, "m"), (1e-3, 1e3, "mm"), (0.0, 1e6, "µm")),
    "s": ((120.0, 1.0 / 60.0, "min"), (1.0, 1.0, "s"), (0.0, 1e3, "ms")),
    "kg": ((1.0, 1.0, "kg"), (0.0, 1e3, "g")),
    "Pa": ((1e6, 1e-6, "MPa"), (1e3, 1e-3, "kPa"), (0.0, 1.0, "Pa")),
    "rad": ((0.0, 180.0 / math.pi, "°"),),
    "m/s": ((0.0, 6e4, "mm/min"),),
    "rev/s": ((0.0, 60.0, "rpm"),),
    "N/m^2": ((0.0, 1e-6, "N/mm²"),),
    "N/m": ((0.0, 1e-3, "N/mm"),),
    "kg m": ((0.0, 1e6, "g mm"),),
    "1": ((0.0, 1.0, ""),),
}


def scale(unit: str, magnitude: float) -> tuple[float, str]:
    """Returns (factor, symbol) that turn an SI value of about `magnitude` into what a workshop says."""
    for least, factor, symbol in _SCALES.get(unit, ((0.0, 1.0, unit),)):
        if abs(magnitude) >= least:
            return factor, symbol
    return 1.0, unit


def number(value: float | None, digits: int = 3) -> str:
    """Returns `value` with that many significant digits; a dash where it is None or not finite."""
    if value is None or not math.isfinite(value):
        return DASH
    if value == 0.0:
        return "0"
    size = int(f"{value:.{digits - 1}e}".split("e")[1])
    if size < -4 or size >= 7:
        return _power(value, digits)
    places = digits - 1 - size
    return _signed(f"{round(value, places):.{max(0, places)}f}")


def percent(share: float | None) -> str:
    """Returns a share of one as a percentage with one decimal; a dash where it is not finite."""
    if share is None or not math.isfinite(share):
        return DASH
    value = 100.0 * share
    return joined(_signed(f"{value:.1f}" if abs(value) < 100 else f"{value:.0f}"), "%")


def chance(p_value: float | None) -> str:
    """Returns a probability in words short enough for a table."""
    if p_value is None or not math.isfinite(p_value):
        return DASH
    if p_value < 1e-15:
        return "< 10⁻¹⁵"
    if p_value < 1e-3:
        return _power(p_value, 1)
    if p_value > 0.995:
        return "1"
    return number(min(p_value, 1.0), 2)


def quantity(value: float | None, unit: str) -> str:
    """Returns an SI value in workshop units, with its unit."""
    if value is None or not math.isfinite(value):
        return DASH
    factor, symbol = scale(unit, value)
    return joined(number(value * factor), symbol)


def interval(value: float | None, low: float | None, high: float | None, unit: str) -> tuple[str, str, str]:
    """Returns (value, "low to high", unit symbol), rounded to two digits of the interval's half-width."""
    if value is None or not math.isfinite(value):
        return DASH, DASH, ""
    ends = [end for end in (low, high) if end is not None and math.isfinite(end)]
    factor, symbol = scale(unit, max(abs(value), *(abs(end) for end in ends)) if ends else abs(value))
    if len(ends) < 2:
        return number(value * factor), DASH, symbol
    half = 0.5 * (ends[1] - ends[0]) * factor
    if half <= 1e-4 * abs(value * factor) or half <= 0.0:
        said = number(value * factor, 4)
        return said, f"{number(ends[0] * factor, 4)} to {number(ends[1] * factor, 4)}", symbol
    places = max(0, 1 - math.floor(math.log10(half)))
    if places > 6:
        return number(value * factor), " to ".join(number(end * factor) for end in ends), symbol
    said, first, last = (_signed(f"{each * factor:.{places}f}") for each in (value, *ends))
    return said, f"{first} to {last}", symbol


def joined(said: str, symbol: str) -> str:
    """Returns a number with its unit symbol, spaced as that unit asks; alone where there is no unit."""
    if not symbol:
        return said
    return said + symbol if symbol == "°" else f"{said}{NO_BREAK}{symbol}"


def _signed(text: str) -> str:
    zero = not any(c in "123456789" for c in text)
    return text.lstrip("-") if zero else text.replace("-", "−")


def _power(value: float, digits: int) -> str:
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    raised = str(int(exponent)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"{_signed(mantissa)} × 10{raised}"
