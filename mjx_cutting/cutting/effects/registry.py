"""Effects by name: registering one makes it known to model files, to tracing and to the command line."""

from __future__ import annotations

import difflib
from typing import TypeVar

from mjx_cutting.cutting.effects.abstract import STAGES, AbstractEffect

_EFFECTS: dict[str, type[AbstractEffect]] = {}
E = TypeVar("E", bound=type[AbstractEffect])


def register(effect: E) -> E:
    """Class decorator: make an effect known by its name.

    Raises:
        ValueError: the class lacks a name, stage or parameters, or another class has the name.
    """
    if not effect.name:
        raise ValueError(f"{effect.__name__} has no name; set the class attribute `name`")
    if effect.stage not in STAGES:
        raise ValueError(f"{effect.name}: stage is {effect.stage!r}; expected one of {', '.join(STAGES)}")
    if effect.strength not in effect.parameters:
        raise ValueError(
            f"{effect.name}: strength is {effect.strength!r}; expected one of its parameters "
            f"({', '.join(effect.parameters) or 'it declares none'})"
        )
    known = _EFFECTS.get(effect.name)
    if known is not None and known.__qualname__ != effect.__qualname__:
        raise ValueError(f"an effect named {effect.name!r} is registered already; choose another name")
    _EFFECTS[effect.name] = effect
    return effect


def effect_names() -> tuple[str, ...]:
    """Names of all registered effects, in order of registration."""
    return tuple(_EFFECTS)


def effect_class(name: str) -> type[AbstractEffect]:
    """The effect of that name.

    Raises:
        ValueError: no such effect; the message offers the nearest names.
    """
    if name in _EFFECTS:
        return _EFFECTS[name]
    near = difflib.get_close_matches(name, _EFFECTS, n=3)
    hint = f"; did you mean {' or '.join(near)}?" if near else ""
    raise ValueError(f"unknown effect {name!r}{hint} Known effects: {', '.join(_EFFECTS)}")
