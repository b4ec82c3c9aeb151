"""The virtual cell: robot, saw and sheet for the policy server, written apart from the simulation.

Nothing of ours is imported here but the packets (`deploy.protocol`), so that what agrees with the simulation
does not agree by construction. docs/virtual_cell.md has the equations.
"""

from __future__ import annotations

from mjx_cutting.deploy.virtual_cell.cell import Cell, CellConfig
from mjx_cutting.deploy.virtual_cell.hidden import Hidden, load

__all__ = ["Cell", "CellConfig", "Hidden", "load"]
