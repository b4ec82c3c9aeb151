"""Traces over time as a strip of pixels, fast enough for every picture of a video."""

from __future__ import annotations

import numpy as np
from PIL import Image, ImageDraw

NAMES = ("force x", "force y", "force z", "deviation", "depth set", "feed set", "volume")
PANELS = (
    ("force on the saw, N", ((0, "x", (31, 119, 180)), (1, "y", (214, 39, 40)), (2, "z", (44, 160, 44)))),
    ("path deviation, mm", ((3, "", (148, 103, 189)),)),
    ("depth mm / feed mm/s /10", ((4, "depth", (140, 86, 75)), (5, "feed", (255, 127, 14)))),
    ("removed volume, mm^3", ((6, "", (23, 150, 160)),)),
)
_GAIN = {5: 0.1}


def draw_traces(time_s: np.ndarray, values: np.ndarray, width: int, height: int) -> np.ndarray:
    """[height, width, 3] picture, uint8.

    Arguments: `time_s` [T]; `values` [T, 7] in order of `NAMES`; size of the picture in pixels.
    """
    image = Image.new("RGB", (width, height), (250, 250, 250))
    pen = ImageDraw.Draw(image)
    panel = width / len(PANELS)
    span = max(float(time_s[-1]), 2.0)
    for index, (title, lines) in enumerate(PANELS):
        left, right = round(index * panel) + 44, round((index + 1) * panel) - 10
        top, bottom = 26, height - 24
        data = np.stack([values[:, k] * _GAIN.get(k, 1.0) for k, _, _ in lines])
        low, high = min(0.0, float(data.min())), max(float(data.max()), 1e-3)
        low, high = low - 0.05 * (high - low), high + 0.05 * (high - low)
        pen.rectangle((left, top, right, bottom), outline=(190, 190, 190), fill=(255, 255, 255))
        pen.text((left, 8), title, fill=(40, 40, 40))
        for mark in (low + 0.05 * (high - low), high - 0.05 * (high - low)):
            level = bottom - (mark - low) / (high - low) * (bottom - top)
            text = f"{mark:.3g}"
            pen.text((left - 6 - 6.2 * len(text), level - 6), text, fill=(90, 90, 90))
        if low < 0.0 < high:
            level = bottom + low / (high - low) * (bottom - top)
            pen.line((left, level, right, level), fill=(215, 215, 215))
        pen.text((right - 42, bottom + 6), f"{span:.0f} s", fill=(90, 90, 90))
        stride = max(1, len(time_s) // (2 * (right - left)))
        x = left + np.asarray(time_s[::stride]) / span * (right - left)
        for row, (_, name, colour) in enumerate(lines):
            y = bottom - (data[row, ::stride] - low) / (high - low) * (bottom - top)
            points = list(zip(x.tolist(), y.tolist(), strict=True))
            if len(points) > 1:
                pen.line(points, fill=colour, width=2)
            if name:
                pen.text((left + 4 + 40 * row, bottom + 6), name, fill=colour)
    return np.asarray(image)
