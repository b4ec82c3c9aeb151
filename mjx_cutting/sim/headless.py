"""Choose an off-screen OpenGL before MuJoCo is imported, where there is no display and none was chosen.

MuJoCo picks its OpenGL when it is imported, by MUJOCO_GL; without a display its default (GLFW) cannot render.
A choice of the user's is never changed.
"""

from __future__ import annotations

import ctypes.util
import os
import sys

INSTALL = "install EGL or OSMesa (Debian: apt-get install libegl1 libosmesa6)"


def choose() -> None:
    """Set MUJOCO_GL to "egl" or "osmesa", whichever library is installed, on a Linux without display."""
    if not _undecided():
        return
    for name, library in (("egl", "EGL"), ("osmesa", "OSMesa")):
        if ctypes.util.find_library(library):
            os.environ["MUJOCO_GL"] = name
            return


def required() -> None:
    """Raise RuntimeError where nothing can draw: a second attempt would end the process inside MuJoCo."""
    if _undecided():
        raise RuntimeError(
            f"no off-screen OpenGL: no display, and neither EGL nor OSMesa is installed; {INSTALL} and start "
            "Python anew"
        )


def _undecided() -> bool:
    """Whether nobody has chosen and there is no display."""
    if "MUJOCO_GL" in os.environ or not sys.platform.startswith("linux"):
        return False
    return not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
