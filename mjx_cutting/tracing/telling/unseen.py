"""Why a record of steady cuts cannot show an effect, and which trial would."""

from __future__ import annotations

from collections.abc import Sequence

BESIDE_LINES = ("regenerative_chatter", "entry_exit")
"""Effects that are not steady and that tracing looks for in a way of their own."""

_NEEDS = {
    "process_damping": (
        "the tool's vibration while it cuts, which no force record holds: measure it at the tool "
        "(position_y_m), or find the depth at which chatter sets in at a quarter of the speed and at the "
        "full speed"
    ),
}


def needs(name: str, absent: Sequence[str] = ()) -> str:
    """What would have to be measured to show an effect of which covariates are `absent`, or which tracing
    does not look for."""
    return _NEEDS.get(name, ", ".join(absent) or "a fit to the whole record, which tracing does not make")
