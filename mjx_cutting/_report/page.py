"""Self-contained pages: figures inline, no script, nothing fetched from anywhere, everything escaped.

A page is a title, a lead, a few facts and sections of blocks. `render_page` makes one from parts;
`environment` gives a room's own jinja2 template the same base (`{% extends "base.html" %}`) and the macros of
`parts.html`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

from mjx_cutting._report.quantities import chance, number, percent, quantity
from mjx_cutting._report.style import figure_to_png, png_to_data_uri

if TYPE_CHECKING:
    from jinja2 import Environment
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Fact:
    """A number in the strip under the lead: what it is, its value with unit, a note in small print.

    `old` is shown before an arrow, where the number was another one before.
    """

    label: str
    value: str
    note: str = ""
    old: str = ""


@dataclass(frozen=True)
class Paragraph:
    """A block of text; `tone` "note" sets it in grey, "warning" in a frame."""

    text: str
    tone: str = ""


@dataclass(frozen=True)
class Listing:
    """A list of sentences; `ordered` numbers them."""

    items: Sequence[str]
    ordered: bool = False


@dataclass(frozen=True)
class Table:
    """Rows of texts under columns.

    Fields: `columns` headings; `rows` cells, one text a column; `numeric` columns set to the right; `marked`
    rows set in bold; `caption` above; `kind` "named" where the
    first column holds short names that stay on one line.
    """

    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    numeric: frozenset[int] = frozenset()
    marked: frozenset[int] = frozenset()
    caption: str = ""
    kind: str = ""


@dataclass(frozen=True, eq=False)
class Picture:
    """A PNG (bytes) with the caption under it and the text that stands for it where it cannot be seen."""

    png: bytes
    caption: str
    alt: str = ""

    @classmethod
    def of(cls, figure: Figure, caption: str, alt: str = "") -> Picture:
        """The picture of a matplotlib figure."""
        return cls(figure_to_png(figure), caption, alt)

    @cached_property
    def uri(self) -> str:
        """The picture as a `data:` address."""
        return png_to_data_uri(self.png)


@dataclass(frozen=True)
class Code:
    """Text set as it is, such as JSON."""

    text: str


Block = Paragraph | Listing | Table | Picture | Code


@dataclass(frozen=True)
class Section:
    """A heading and its blocks; `folded` hides them until the reader opens the section."""

    title: str
    blocks: Sequence[Block] = field(default_factory=tuple)
    folded: bool = False


def environment(*packages: str) -> Environment:
    """Returns a jinja2 environment that finds templates in the `templates` folder of each package, then ours.

    Text is escaped, an unknown name in a template is an error, and the filters `number`, `percent`, `chance`
    and `quantity` write numbers.
    """
    import jinja2

    loaders = [jinja2.PackageLoader(name, "templates") for name in (*packages, "mjx_cutting._report")]
    env = jinja2.Environment(
        loader=jinja2.ChoiceLoader(loaders),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    filters: dict[str, Any] = {"number": number, "percent": percent, "chance": chance, "quantity": quantity}
    env.filters.update(filters)
    env.filters["kind"] = lambda block: type(block).__name__.lower()
    return env


def render_page(
    title: str,
    sections: Sequence[Section],
    *,
    lead: str = "",
    tag: str = "",
    tone: str = "plain",
    facts: Sequence[Fact] = (),
    about: str = "",
) -> str:
    """Returns a whole HTML page.

    Args:
        title: heading of the page.
        sections: what it holds, in order.
        lead: the finding, in a sentence or two.
        tag: a word in a coloured chip beside the title, such as "passed".
        tone: colour of the chip: "good", "part", "open" or "plain".
        facts: numbers in the strip under the lead.
        about: small print at the end: what made the page, from what.
    """
    page = environment().get_template("page.html")
    return page.render(
        title=title, sections=sections, lead=lead, tag=tag, tone=tone, facts=facts, about=about
    )
