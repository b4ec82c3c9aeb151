"""Numbers as a report shows them."""

from __future__ import annotations

import pytest

from mjx_cutting._report.quantities import chance, interval, number, percent, quantity

NAN, INF = float("nan"), float("inf")


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (0.0, "0"),
        (12.345, "12.3"),
        (0.99996, "1.00"),
        (-0.012345, "−0.0123"),
        (123456.0, "123000"),
        (1.5e9, "1.50 × 10⁹"),
        (2e-7, "2.00 × 10⁻⁷"),
        (None, "–"),
        (NAN, "–"),
        (-INF, "–"),
    ],
)
def test_numbers_have_three_digits(value: float | None, shown: str) -> None:
    assert number(value) == shown


@pytest.mark.parametrize(
    ("value", "unit", "shown"),
    [
        (1.16e-5, "m", "11.6 µm"),
        (0.003, "m", "3.00 mm"),
        (0.7853981633974483, "rad", "45.0°"),
        (8.59e8, "N/m^2", "859 N/mm²"),
        (100.0, "rev/s", "6000 rpm"),
        (0.25, "1", "0.250"),
        (4.0, "widgets", "4.00 widgets"),
        (NAN, "m", "–"),
    ],
)
def test_quantities_are_in_workshop_units(value: float, unit: str, shown: str) -> None:
    assert quantity(value, unit).replace("\u00a0", " ") == shown


@pytest.mark.parametrize(
    ("given", "shown"),
    [
        ((1.16e-5, 1.1e-5, 1.22e-5, "m"), ("11.60", "11.00 to 12.20", "µm")),
        ((1.23e-5, 3.1e-6, 2.16e-5, "m"), ("12.3", "3.1 to 21.6", "µm")),
        ((859e6, 400e6, 1300e6, "N/m^2"), ("859", "400 to 1300", "N/mm²")),
        ((0.2, -0.1, 0.5, "1"), ("0.20", "−0.10 to 0.50", "")),
        ((0.2, None, NAN, "1"), ("0.200", "–", "")),
        ((None, 0.0, 1.0, "m"), ("–", "–", "")),
        ((0.0, 0.0, 0.0, "rad"), ("0", "0 to 0", "°")),
    ],
)
def test_an_interval_is_rounded_to_what_is_known(given: tuple, shown: tuple[str, str, str]) -> None:
    assert interval(*given) == shown


def test_percentages_and_chances() -> None:
    shown = [percent(0.1265), percent(-0.001), percent(-0.0001), percent(12.0), percent(NAN)]
    assert [each.replace("\u00a0", " ") for each in shown] == ["12.7 %", "−0.1 %", "0.0 %", "1200 %", "–"]
    assert [chance(p) for p in (0.0, 2.3e-6, 0.0123, 0.5, 1.0, NAN)] == [
        "< 10⁻¹⁵",
        "2 × 10⁻⁶",
        "0.012",
        "0.50",
        "1",
        "–",
    ]
