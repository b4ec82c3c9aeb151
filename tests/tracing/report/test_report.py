"""report.html from tracings made by hand: every verdict, any number of trials, hostile names."""

from __future__ import annotations

import base64
import json
import re
import struct
from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser
from typing import Any

import pytest

from mjx_cutting._report.page import Picture
from mjx_cutting._report.style import figure_to_png
from mjx_cutting.tracing.report import page, wording
from mjx_cutting.tracing.report.figures import trials_figure
from mjx_cutting.tracing.report.page import render
from mjx_cutting.tracing.told import Tracing
from mjx_cutting.trials.dataset import LeftOut

Make = Callable[..., Tracing]
WORDS = ("explained", "partly explained", "ambiguous", "unexplained", "nothing missing")


class Page(HTMLParser):
    """Reads a page: its words, its pictures, its tags; notes what is not closed."""

    _ALONE = frozenset({"meta", "img", "br", "hr", "link", "input"})

    def __init__(self, page: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: set[str] = set()
        self.pictures: list[dict[str, str]] = []
        self.links: list[str] = []
        self.words: list[str] = []
        self.lead = ""
        self._in_lead = False
        self.feed(page)
        self.lead = " ".join(self.lead.split())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        self.tags.add(tag)
        self.links += [value for name, value in given.items() if name in ("src", "href", "action", "poster")]
        if tag == "img":
            self.pictures.append(given)
        if tag not in self._ALONE:
            self.open.append(tag)
        self._in_lead = tag == "p" and given.get("class", "").startswith("lead")

    def handle_endtag(self, tag: str) -> None:
        assert self.open and self.open[-1] == tag, f"</{tag}> closes {self.open[-3:]}"
        self.open.pop()
        self._in_lead = False

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] == "style":
            assert "url(" not in data and "@import" not in data
            return
        self.words.append(data)
        self.lead += data if self._in_lead else ""

    @property
    def text(self) -> str:
        """All words, one space apart."""
        return " ".join(" ".join(self.words).split())


def _read(tracing: Tracing) -> Page:
    page = Page(render(tracing))
    assert not page.open
    assert "script" not in page.tags
    assert page.links and all(link.startswith("data:image/png;base64,") for link in page.links)
    assert not re.search(r"\b(nan|NaN|inf|None)\b", page.text)
    return page


def _sizes(page: Page) -> list[tuple[int, int]]:
    """Width and height of every picture, from its PNG header."""
    sizes = []
    for picture in page.pictures:
        png = base64.b64decode(picture["src"].partition(",")[2])
        assert png[:8] == b"\x89PNG\r\n\x1a\n" and len(png) > 5000
        assert picture["alt"]
        sizes.append(struct.unpack(">II", png[16:24]))
    return sizes


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leaves the drawing out where only words are looked at."""
    names = ("revolution", "spectrum", "trials", "telling", "isolability", "intervals")
    drawn = {name: Picture(b"drawn", name) for name in names}
    monkeypatch.setattr(page, "_pictures", lambda tracing: drawn)


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize(
    ("word", "told"),
    [
        (
            "explained",
            ["The force model lacks radial runout", "12.00 µm, 95 % interval", "falls from 30.0 % to 10.0 %"],
        ),
        ("partly explained", ["The force model lacks radial runout", "still depends on spindle order"]),
        ("ambiguous", ["cannot tell whether it is radial runout or unequal pitch", "a feed range of 10:1"]),
        ("unexplained", ["none of the 2 known effects", "30.0 % of the force", "depends on spindle order"]),
        ("nothing missing", ["Nothing is missing", "these 5 trials", "30.0 % of the force"]),
    ],
)
def test_the_finding_comes_first_in_two_sentences(make_tracing: Make, word: str, told: list[str]) -> None:
    tracing = make_tracing(word)
    page = _read(tracing)
    for part in told:
        assert part in page.lead
    assert len(re.findall(r"[.](?=\s|$)", page.lead.strip())) == 2
    assert page.text.index(word) < page.text.index(told[0]) < page.text.index("One revolution")
    assert wording.TONES[word]


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize(
    ("tried", "told"), [(0, "no known effect could be tried"), (1, "the one known effect that")]
)
def test_few_tried_effects_are_told_as_they_are(make_tracing: Make, tried: int, told: str) -> None:
    for word in ("unexplained", "nothing missing"):
        tracing = make_tracing(word)
        first = tracing.search.rounds[0]
        few = replace(tracing.search, rounds=(replace(first, candidates=first.candidates[:tried]),))
        assert told in _read(replace(tracing, search=few)).lead


def test_every_verdict_word_of_the_format_has_words_and_a_tone() -> None:
    assert set(wording.TONES) == set(WORDS)


@pytest.mark.parametrize("trials", [2, 5, 100])
def test_any_number_of_trials_makes_figures_of_page_size(make_tracing: Make, trials: int) -> None:
    page = _read(make_tracing(trials=trials))
    sizes = _sizes(page)
    assert len(sizes) == 5
    for width, height in sizes:
        assert width == 1196
        assert 150 < height < 1800


@pytest.mark.parametrize("word", ["unexplained", "nothing missing"])
def test_without_a_named_effect_no_figure_speaks_of_after(make_tracing: Make, word: str) -> None:
    page = _read(make_tracing(word))
    assert len(_sizes(page)) == 5
    assert "with what was named" not in page.text
    assert "Named:" not in page.text


@pytest.mark.parametrize(
    "fields",
    [{"same_feed": True}, {"teeth": 1}, {"teeth": 80}, {"band_hz": (0.0, 20.0)}, {"band_hz": (30.0, 900.0)}],
)
def test_odd_designs_are_drawn(make_tracing: Make, fields: dict[str, Any]) -> None:
    expected = 4 if fields.get("same_feed") or fields.get("band_hz") == (0.0, 20.0) else 5
    assert len(_sizes(_read(make_tracing(**fields)))) == expected


def test_whatever_the_data_set_says_is_escaped(make_tracing: Make) -> None:
    evil = '<script>alert("1")</script>$\\frac{$ & \u4e2d {{ 7 * 7 }}'
    tracing = make_tracing(
        name=evil,
        files="{:03d}$_<b>" + "x" * 80 + "$.csv",
        source=evil,
        licence=evil,
        warnings=(evil,),
        left_out=(LeftOut(evil + ".csv", evil),),
    )
    page = _read(tracing)
    assert "b" not in page.tags
    assert page.text.count('<script>alert("1")</script>') >= 6
    assert "{{ 7 * 7 }}" in page.text


@pytest.mark.usefixtures("quick")
def test_the_folded_verdict_is_the_verdict(make_tracing: Make) -> None:
    tracing = make_tracing()
    source = render(tracing)
    folded = Page(source[source.index("<pre>") : source.index("</pre>") + 6])
    assert json.loads("".join(folded.words)) == tracing.verdict


@pytest.mark.usefixtures("quick")
def test_numbers_of_the_search_stand_in_the_tables(make_tracing: Make) -> None:
    page = _read(make_tracing())
    for part in (
        "30.0 %",
        "10.0 %",
        "31.0 %",
        "error does not fall; runs to <its> edge",
        "refused",
        "named",
        "< 10⁻¹⁵",
    ):
        assert part in page.text
    assert "Runner-up: unequal pitch, which would leave 31.0 %" in page.text


@pytest.mark.usefixtures("quick")
def test_many_candidates_are_folded_after_the_best(make_tracing: Make) -> None:
    tracing = make_tracing()
    first = tracing.search.rounds[0]
    many = replace(first, candidates=first.candidates + first.candidates[1:] * 29)
    tracing = replace(tracing, search=replace(tracing.search, rounds=(many,)))
    assert "23 more, with larger errors" in _read(tracing).text


def test_rendering_is_repeatable_and_leaves_matplotlib_alone(make_tracing: Make) -> None:
    import matplotlib

    settings = dict(matplotlib.rcParams)
    tracing = make_tracing()
    first, second = (figure_to_png(trials_figure(tracing)) for _ in range(2))
    assert first == second
    assert dict(matplotlib.rcParams) == settings
