"""Physics at the tool: pure functions of arrays, from spindle angle to sensed force."""

from mjx_cutting.cutting.cut import Cut
from mjx_cutting.cutting.effects import AbstractEffect, Parameter, effect_class, effect_names, register
from mjx_cutting.cutting.engagement import MILLING, arc
from mjx_cutting.cutting.material import Material
from mjx_cutting.cutting.model import ForceModel
from mjx_cutting.cutting.orders import order_lines, revolution
from mjx_cutting.cutting.tool import Tool

__all__ = [
    "MILLING",
    "AbstractEffect",
    "Cut",
    "ForceModel",
    "Material",
    "Parameter",
    "Tool",
    "arc",
    "effect_class",
    "effect_names",
    "order_lines",
    "register",
    "revolution",
]
