"""What a recorded session is: tool, sensor and conditions, from a file or from the policy's training."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from mjx_cutting.deploy.artefact import Artefact


def read(path: Path) -> dict[str, Any]:
    """Returns the session that a JSON file describes; docs/serving.md shows one.

    Raises:
        ValueError: there is no such file, or it is no JSON object.
    """
    try:
        session = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ValueError(f"got {path}, which is no readable JSON ({error}); see docs/serving.md") from None
    if not isinstance(session, dict):
        raise ValueError(f"got {path} with {type(session).__name__} at the top; expected an object")
    return session


def of(artefact: Artefact, material: str | None = None) -> dict[str, Any]:
    """Returns the session that a policy's training environment describes.

    Arguments: artefact; material of the sheet, None where unknown.

    Raises:
        ValueError: the policy's file does not name its environment.
    """
    env = artefact.provenance.get("env")
    if not isinstance(env, dict):
        raise ValueError(
            "got a policy whose file does not say which tool it was trained with; expected that, or a "
            "description of the session: give --session session.json (docs/serving.md shows one)"
        )
    corner_hz = env["force_lowpass_hz"]
    return {
        "name": "recorded",
        "source": f"mjx-cutting serve, policy {artefact.sha256[:16]}",
        "tool": {"kind": "slitting_saw", "teeth": env["teeth"], "diameter_m": env["diameter_m"]},
        "sensor": {
            "sample_rate_hz": env["physics_rate_hz"],
            "noise_std_n": list(env["force_noise_n"]),
            "zeroed": "session",
            "anti_alias": {"kind": "butterworth", "order": 1, "hz": corner_hz} if corner_hz else None,
        },
        "trial": {
            "milling": "conventional",
            "material": material,
            "axial_width_m": env["kerf_m"],
            "spindle_speed_rev_s": env["spindle_speed_rev_s"],
        },
    }


def nominal_feed_m_s(artefact: Artefact, default: float) -> float:
    """Returns the nominal feed, m/s, of the environment that a policy's file names, or the default."""
    env = artefact.provenance.get("env")
    return float(env["nominal_feed_m_s"]) if isinstance(env, dict) else default
