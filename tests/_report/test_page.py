"""Pages from parts: whole, escaped, with nothing fetched."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest

from mjx_cutting._report.page import Code, Fact, Listing, Paragraph, Picture, Section, Table, render_page
from mjx_cutting._report.style import figure_to_png, new_figure, plain, style_axes

EVIL = "<img src=x onerror=1> & $x^$"


def _picture() -> Picture:
    figure = new_figure(1.5)
    axes = figure.subplots()
    axes.plot([0, 1], [0, 1])
    style_axes(axes, title=EVIL, x="time (s)", y="force (N)")
    return Picture.of(figure, caption=EVIL)


def test_a_page_holds_all_its_blocks_and_nothing_from_elsewhere() -> None:
    table = Table(("a", "b"), [(EVIL, "1"), ("row", "2")], frozenset({1}), frozenset({0}), caption="Two rows")
    blocks = (
        Paragraph("plain words"),
        Listing(("one", EVIL), ordered=True),
        table,
        _picture(),
        Code('{"k": 1}'),
    )
    page = render_page(
        EVIL,
        [Section("Open", blocks), Section("Closed", (Paragraph("inside", "note"),), folded=True)],
        lead="The finding.",
        tag="passed",
        tone="good",
        facts=[Fact("error", "12.6 %", "in small print", old="32.3 %")],
        about="made by a test",
    )
    assert page.startswith("<!DOCTYPE html>") and page.rstrip().endswith("</html>")
    assert "<img src=x" not in page and page.count("&lt;img src=x") == 6
    assert set(re.findall(r'(?:src|href)="([^"]{0,22})', page)) == {"data:image/png;base64,"}
    for gone in ("<script", "@import", "url(", "http"):
        assert gone not in page
    for held in (
        "plain words",
        "Two rows",
        "32.3 %",
        "<summary>Closed</summary>",
        "{&#34;k&#34;: 1}",
        "<ol>",
    ):
        assert held in page
    assert 'class="chip good"' in page


def test_the_order_of_sections_is_kept() -> None:
    page = render_page("t", [Section(name) for name in ("first", "second", "third")])
    assert page.index("<h2>first") < page.index("<h2>second") < page.index("<h2>third")


def test_figures_are_the_same_each_time_and_need_no_pyplot() -> None:
    code = (
        "import sys; from mjx_cutting._report.style import new_figure, figure_to_png, style_axes\n"
        "figure = new_figure(1.0); style_axes(figure.subplots(), x='x (m)')\n"
        "assert figure_to_png(figure)[:4] == b'\\x89PNG'\n"
        "assert 'matplotlib.pyplot' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=120)
    assert _picture().png == _picture().png
    assert len(figure_to_png(new_figure(0.5))) > 100


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("5 $ and $6", r"5 \$ and \$6"),
        ("a\nb\x00", "a?b?"),
        ("\u4e2d.csv", "?.csv"),
        ("12.6\u00a0%", "12.6 %"),
    ],
)
def test_texts_in_figures_are_plain(text: str, shown: str) -> None:
    assert plain(text) == shown


def test_long_texts_in_figures_are_cut_in_the_middle() -> None:
    cut = plain("start" + "x" * 200 + "end.csv", longest=30)
    assert len(cut) <= 30 and cut.startswith("start") and cut.endswith("end.csv") and "…" in cut


def test_importing_the_room_loads_no_drawing_library() -> None:
    code = (
        "import sys, mjx_cutting._report.page\n"
        "assert not {'matplotlib', 'jinja2', 'numpy', 'jax'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=120)
