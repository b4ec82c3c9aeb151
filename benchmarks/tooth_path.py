"""What the true path of the teeth makes of chip and force, beside circles.

    python benchmarks/tooth_path.py [--json FILE]

For end mills and saws: how far the closed form (`cutting.chip.fed`) and circles are off the chip found by
iteration, as shares of the feed per tooth c; and what of the force of three feeds (.3 c, .6 c, c) on the true
path is left when the constants of a model on circles are fitted to it, as a share of that force and over
c / R. Exact calculation: no noise, no timing, the same on every machine.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from mjx_cutting import _files, _platform
from mjx_cutting.cutting import Cut, ForceModel, Material, Tool, arc
from mjx_cutting.cutting.chip import fed, nominal_cutter
from mjx_cutting.cutting.effects.tooth_path import ToothPath

RADIUS_M, WIDTH_M, SPEED_REV_S = 0.01, 0.002, 20.0
FEEDS = (0.3, 0.6, 1.0)
CHIP_N_M2, EDGE_SHARE, RADIAL_SHARE = 1e9, 0.1, 0.3
ANGLES, ITERATIONS = 400, 20
MILLS = [
    ("end_mill", milling, depth, teeth, share)
    for milling, depth in (("slot", 2.0), ("climb", 0.5), ("conventional", 0.5), ("climb", 1.0))
    for teeth in (2, 4, 6)
    for share in (0.02, 0.05)
]
SAWS = [
    ("slitting_saw", milling, depth, teeth, 0.002)
    for milling in ("climb", "conventional")
    for depth in (0.05, 0.16)
    for teeth in (12, 20, 40, 100)
]


def main() -> None:
    """Parse the command line, calculate, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", type=Path, help="write all figures to this file")
    given = parser.parse_args()
    with _platform.x64():
        rows = [row(*case) for case in (*MILLS, *SAWS)]
    for each in rows:
        print(json.dumps(each))
    if given.json:
        told = {"command": ["python", *sys.argv], "versions": _platform.versions(), "rows": rows}
        _files.write_atomic(given.json, json.dumps(told, indent=1) + "\n")


def row(kind: str, milling: str, depth: float, teeth: int, share: float) -> dict[str, Any]:
    """Figures of one tool in one arc, `depth` in radii, feed per tooth `share` of the radius."""
    tool = Tool(kind, teeth, 2.0 * RADIUS_M)
    entry, exit_ = (float(each) for each in arc(milling, depth * RADIUS_M, 2.0 * RADIUS_M))
    angle = entry + (exit_ - entry) * (np.arange(ANGLES) + 0.5) / ANGLES
    chip_m = share * RADIUS_M
    exact = by_iteration(angle, chip_m, teeth)
    curved = nominal_cutter(tool)._replace(curvature_1_m=jnp.asarray(1.0 / RADIUS_M))
    closed = np.asarray(fed(curved, jnp.asarray(chip_m), jnp.asarray(chip_m * teeth), jnp.asarray(angle)))
    left = left_on_circles(tool, milling, depth, chip_m)
    return {
        "tool": kind,
        "milling": milling,
        "depth_radii": depth,
        "teeth": teeth,
        "c_over_r": share,
        "closed_form_off_c": float(np.max(np.abs(closed - exact)) / chip_m),
        "circles_off_c": float(np.max(np.abs(chip_m * np.sin(angle) - exact)) / chip_m),
        "force_left_on_circles": left,
        "force_left_over_c_over_r": left / share,
    }


def by_iteration(angle: NDArray[np.floating], chip_m: float, teeth: int) -> NDArray[np.floating]:
    """[K] chip of a tooth at `angle` [K], from where the tool was when the tooth before left that ray."""
    pitch, sine, cosine = 2.0 * np.pi / teeth, np.sin(angle), np.cos(angle)
    advance = np.full_like(angle, chip_m)
    for _ in range(ITERATIONS):
        along = np.sqrt(RADIUS_M**2 - (advance * cosine) ** 2) - advance * sine
        then = np.arctan2(along * sine + advance, along * cosine)
        advance = chip_m * (pitch + angle - then) / pitch
    return np.asarray(RADIUS_M - along)


def left_on_circles(tool: Tool, milling: str, depth: float, chip_m: float) -> float:
    """Share of the force of one tooth over its arc that fitted constants on circles leave."""
    edge = EDGE_SHARE * CHIP_N_M2 * chip_m
    true = Material(CHIP_N_M2, edge, RADIAL_SHARE * CHIP_N_M2, RADIAL_SHARE * edge, 0.0, 0.0)
    force = in_arc(ForceModel(tool, true, (ToothPath(1.0, cusps=0.0),)), milling, depth, chip_m)
    unit = [Material(*one) for one in np.eye(6)[:4]]
    columns = np.stack([in_arc(ForceModel(tool, each), milling, depth, chip_m) for each in unit], axis=1)
    columns /= np.linalg.norm(columns, axis=0)
    fitted = columns @ np.linalg.lstsq(columns, force, rcond=None)[0]
    return float(np.linalg.norm(force - fitted) / np.linalg.norm(force))


def in_arc(model: ForceModel, milling: str, depth: float, chip_m: float) -> NDArray[np.floating]:
    """[n] the force in the plane of one tooth over its arc, at each of the feeds."""
    share = jnp.asarray((np.arange(ANGLES) + 0.5) / ANGLES)
    parts = []
    for feed in FEEDS:
        cut = Cut.milling(
            milling,
            2.0 * RADIUS_M,
            angle_rad=0.0,
            spindle_speed_rev_s=SPEED_REV_S,
            feed_speed_m_s=feed * chip_m * model.tool.teeth * SPEED_REV_S,
            radial_depth_m=depth * RADIUS_M,
            axial_width_m=WIDTH_M,
        )
        force = model.elements_in_arc(cut, share, jnp.full(ANGLES, 1.0 / ANGLES))[0]
        parts.append(np.asarray(force[:, 0, 0, :2]).ravel())
    return np.concatenate(parts)


if __name__ == "__main__":
    main()
