"""Which orders of the spindle are worth following: tooth passing and its sidebands, as far as they are heard.

A record without a filter tells some hundred orders apart, and what it costs to hold a model against them goes
with the square of their number; most hold noise alone. Orders as far from a multiple of tooth passing are
taken together (what makes teeth unlike once a turn stands one order beside it at every harmonic), and
followed up to the last beyond which they are not louder than noise, in all trials together.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]
_FEWEST = 24
_UNHEARD = 3e-4
_BY_CHANCE = 4.0
_FAR = 1e-3


def followed_orders(
    whitened: Array, present: Array, noise_n2: Array, energy_n2: float, teeth: int
) -> NDArray[np.bool_]:
    """[orders + 1] True for the constant, all low orders, and those that are heard.

    Arguments:
        whitened: [R, 2 orders + 1, A] lines of every trial, each less what those before it explain (`Lines`).
        present: [R, 2 orders + 1] 1 where a line lies in the band of its trial.
        noise_n2: [R, A] mean square of noise in one of them.
        energy_n2: of the records, over all trials and axes.
        teeth: N.
    """
    # a channel without noise was not connected: it holds nothing that could hide a line
    count = (present[:, 1::2] + present[:, 2::2])[..., None] * (noise_n2 > 0.0)[:, None]
    square = whitened[:, 1::2] ** 2 + whitened[:, 2::2] ** 2
    noise = np.maximum(noise_n2, np.finfo(float).tiny)[:, None]
    # in units of each trial's noise, since one that chatters hides nothing that the others show
    excess, larger = (each.sum(axis=(0, 2)) for each in (square / noise - count, square - count * noise))
    variance = 2.0 * count.sum(axis=(0, 2))
    order = np.arange(1, len(excess) + 1)
    apart = np.minimum(order % teeth, -order % teeth)
    followed = np.concatenate([[True], order <= max(_FEWEST, teeth + 1)])
    little_n2 = _UNHEARD**2 * energy_n2 / (1 + apart.max(initial=0))
    for distance in range(teeth // 2 + 1):
        alike = np.flatnonzero(apart == distance)
        over, by_chance, size_n2 = (np.cumsum(each[alike][::-1])[::-1] for each in (excess, variance, larger))
        heard = np.flatnonzero((over > _BY_CHANCE * np.sqrt(by_chance)) & (size_n2 > little_n2))
        followed[1 + alike[: 1 + heard.max(initial=-1)]] = True
    return followed


def without_far_orders(
    followed: NDArray[np.bool_], whitened: Array, energy_n2: float, near: int
) -> NDArray[np.bool_]:
    """[orders + 1] those `followed` without the highest, above order `near`, that together hold less than a
    thousandth of the force: what they cost goes with the order too. The rest is as in `followed_orders`."""
    square = np.sum(whitened[:, 1::2] ** 2 + whitened[:, 2::2] ** 2, axis=(0, 2)) * followed[1:]
    beyond = np.concatenate([np.cumsum(square[::-1])[::-1], [0.0]])
    needed = int(np.argmax(beyond <= _FAR**2 * energy_n2))
    return followed & (np.arange(len(followed)) <= max(needed, near))
