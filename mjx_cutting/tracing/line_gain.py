"""What a known anti-alias filter and a straight-toothed model's missing helix do to each line of a record."""

from __future__ import annotations

from typing import Any

import numpy as np

from mjx_cutting.trials.dataset import AntiAlias, Dataset, Sensor


def line_gain(
    dataset: Dataset, speed_rev_s: np.ndarray[Any, Any], width_m: np.ndarray[Any, Any], orders: int
) -> np.ndarray[Any, Any]:
    """[R, orders + 1] complex response at each order of the known anti-alias filter and of the helix.

    Arguments: dataset; `speed_rev_s` [R] spindle speeds; `width_m` [R] widths of cut; highest order.
    """
    frequency = np.multiply.outer(speed_rev_s, np.arange(orders + 1))
    return _filter_gain(dataset, frequency) * _helix_gain(dataset, width_m, orders)


def filter_delay_s(sensor: Sensor) -> float:
    """[] by how much later what is slow against the known anti-alias filter is seen behind it."""
    alias = sensor.anti_alias
    if alias is None or alias.zero_phase:
        return 0.0
    return float(-np.sum((1.0 / _poles(alias)).real) / (2.0 * np.pi * alias.hz))


def _poles(alias: AntiAlias) -> np.ndarray[Any, Any]:
    """[order] poles of a Butterworth low-pass of corner 1 rad/s."""
    return np.exp(1j * np.pi * (2 * np.arange(1, alias.order + 1) + alias.order - 1) / (2 * alias.order))


def _filter_gain(dataset: Dataset, frequency: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    alias = dataset.sensor.anti_alias
    if alias is None:
        return np.ones_like(frequency, dtype=complex)
    poles = _poles(alias)
    gain = np.prod(-poles / (1j * frequency[..., None] / alias.hz - poles), axis=-1)
    return np.abs(gain) ** 2 + 0j if alias.zero_phase else gain


def _helix_gain(dataset: Dataset, width: np.ndarray[Any, Any], orders: int) -> np.ndarray[Any, Any]:
    """[R, orders + 1] mean of exp(-i n lag) over the width of cut."""
    lag = 2.0 * width * np.tan(dataset.tool.helix_rad) / dataset.tool.diameter_m
    half = 0.5 * np.multiply.outer(lag, np.arange(orders + 1))
    return np.sinc(half / np.pi) * np.exp(-1j * half)
