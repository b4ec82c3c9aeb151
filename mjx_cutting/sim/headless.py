"""Choose an off-screen OpenGL before MuJoCo is imported, where there is no display and none was chosen.

MuJoCo picks its OpenGL when it is imported, by MUJOCO_GL; without a display its default (GLFW) cannot render.
A choice of the user's is never changed.
"""

from __future__ import annotations

import ctypes.util
import os
import sys


def choose() -> None:
    """Set MUJOCO_GL to "egl" or "osmesa", whichever library is installed, on a Linux without display."""
    if "MUJOCO_GL" in os.environ or not sys.platform.startswith("linux"):
        return
    if os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        return
    for name, library in (("egl", "EGL"), ("osmesa", "OSMesa")):
        if ctypes.util.find_library(library):
            os.environ["MUJOCO_GL"] = name
            return
