"""A table of a JSON or TOML document that knows where it stands and how to complain.

The idea: values are fetched through `Keys`, so that each message names the key path
("trials[3].feed_speed_m_s"), what was got, what was expected and how to mend it, and keys nobody asked for
are warned of. Missing and null are the same.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np


@dataclass
class Keys:
    """A JSON or TOML table that knows its path in the document, which keys were asked for, and how to
    complain.
    """

    table: Mapping[str, Any]
    path: str
    asked: set[str] = field(default_factory=set)

    def where(self, key: str) -> str:
        """The key's path in the document."""
        return f"{self.path}.{key}" if self.path else key

    def fault(self, key: str, expected: str, mend: str) -> ValueError:
        """The error to raise for a key: got, expected, how to mend."""
        got = shown(self.table[key]) if key in self.table else "nothing (the key is missing)"
        return ValueError(f"{self.where(key)}: got {got}, expected {expected}; {mend}.")

    def absent(self, key: str) -> bool:
        """Marks the key as known; True where it is missing or null."""
        self.asked.add(key)
        return self.table.get(key) is None

    def number(self, key: str, *, above: float | None = None, least: float | None = None) -> float:
        """A finite number, `> above` or `>= least` where given."""
        expected = "a number"
        if above is not None:
            expected = f"a number greater than {above:g}"
        if least is not None:
            expected = f"a number not less than {least:g}"
        value = None if self.absent(key) else self.table[key]
        if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
            raise self.fault(key, expected, "write it as a plain number in SI units, without quotes")
        if (above is not None and value <= above) or (least is not None and value < least):
            raise self.fault(key, expected, "correct the value (SI units)")
        return float(value)

    def whole(self, key: str, *, least: int) -> int:
        """A whole number of at least `least`."""
        value = None if self.absent(key) else self.table[key]
        if isinstance(value, float) and value.is_integer():
            value = int(value)
        if isinstance(value, bool) or not isinstance(value, int) or value < least:
            raise self.fault(key, f"a whole number of at least {least}", "correct the value")
        return value

    def text(self, key: str, *, default: str | None = None) -> str | None:
        """A string, or `default` where missing or null."""
        if self.absent(key):
            return default
        value = self.table[key]
        if not isinstance(value, str):
            raise self.fault(key, "text in quotes", "write it in quotes or leave the key out")
        return value

    def choice(self, key: str, allowed: tuple[str, ...], *, default: str | None = None) -> str:
        """One of the allowed words."""
        if default is not None and self.absent(key):
            return default
        if self.absent(key) or self.table[key] not in allowed:
            raise self.fault(key, "one of " + ", ".join(f'"{word}"' for word in allowed), "correct the word")
        return str(self.table[key])

    def flag(self, key: str, *, default: bool) -> bool:
        """true or false."""
        if self.absent(key):
            return default
        if not isinstance(self.table[key], bool):
            raise self.fault(key, "true or false", "write it without quotes")
        return bool(self.table[key])

    def section(self, key: str) -> Keys:
        """The table under a key."""
        if self.absent(key) or not isinstance(self.table[key], Mapping):
            raise self.fault(key, "an object { ... }", "add it as docs/dataset.md shows")
        return Keys(self.table[key], self.where(key))

    def unknown(self) -> list[str]:
        """A warning for each key nobody asked for."""
        return [
            f"{self.where(key)}: unknown key, ignored; known here: {', '.join(sorted(self.asked))}."
            for key in self.table
            if key not in self.asked
        ]


def shown(value: Any) -> str:
    """A value as JSON, cut to 60 characters."""
    text = json.dumps(value, default=str)
    return text if len(text) <= 60 else text[:57] + "..."
