"""report.html: the finding in two sentences, then numbers, figures and tables; one file that needs no other.

`render` gathers what the template shows; the words are in `wording` and `advice`, the drawings in `figures`.
Everything that came with the data set is escaped by the template or made plain by the figures.
"""

from __future__ import annotations

import json
import math
from typing import Any

import mjx_cutting
from mjx_cutting._report.page import Fact, Picture, Table, environment
from mjx_cutting._report.quantities import chance, interval, joined, number, percent, quantity
from mjx_cutting.tracing.along.slow_round import SlowRound
from mjx_cutting.tracing.naming.candidate import Round
from mjx_cutting.tracing.report import advice, figures, wording
from mjx_cutting.tracing.report.figures.subject import subjects
from mjx_cutting.tracing.report.parameters import estimates
from mjx_cutting.tracing.telling.dependence import Dependence
from mjx_cutting.tracing.told import Tracing

_ACROSS = ("feed", "spindle speed", "radial depth", "cut length", "clock time")
_CANDIDATES_SHOWN = 8
_TRIALS_SHOWN = 20


def render(tracing: Tracing) -> str:
    """Returns the report of a tracing as one self-contained HTML page.

    Args:
        tracing: what `trace` returned.
    """
    verdict = tracing.verdict
    page = environment("mjx_cutting.tracing.report").get_template("trace.html")
    return page.render(
        title=f"What the force model lacks: {tracing.dataset.name}",
        tag=verdict["verdict"],
        tone=wording.TONES[verdict["verdict"]],
        lead=" ".join(wording.finding(tracing)),
        facts=_facts(tracing),
        effects=_effects(tracing),
        pictures=_pictures(tracing),
        rounds=_rounds(tracing),
        parameters=_parameters(tracing),
        dependences=_dependences(tracing),
        remaining=verdict["remaining"],
        ambiguous=_ambiguous(verdict),
        not_testable=_not_testable(verdict),
        proposals=advice.proposals(tracing),
        caveats=advice.caveats(tracing),
        left_out=_left_out(verdict),
        trials=_trials(tracing),
        trials_folded=len(tracing.before) > _TRIALS_SHOWN,
        how=advice.held_out_how(tracing),
        dataset=tracing.dataset,
        tool=_tool(tracing),
        verdict_json=json.dumps(verdict, indent=2, allow_nan=False),
        made=mjx_cutting.__version__,
    )


def _rounds(tracing: Tracing) -> list[dict[str, Any]]:
    steady = [_round(index, each) for index, each in enumerate(tracing.search.rounds)]
    return steady + [_round(len(steady) + index, each) for index, each in enumerate(tracing.slow)]


def _facts(tracing: Tracing) -> list[Fact]:
    verdict = tracing.verdict
    before, after = (verdict[key]["heldout_nrmse"] for key in ("before", "after"))
    error = percent(after)
    changed = bool(verdict["effects"])
    facts = [
        Fact(
            "Error on held-out trials",
            error,
            "RMS of measured minus predicted, in % of the RMS force",
            percent(before) if changed else "",
        ),
        Fact(
            "Noise floor", percent(verdict["noise_floor_nrmse"]), "the error sensor noise alone would leave"
        ),
    ]
    for entry in verdict["effects"]:
        for name, one in _strength_first(tracing, entry)[:1]:
            value, ends, unit = interval(one["value"], one["low"], one["high"], one["unit"])
            label = f"{wording.spoken(entry['name'])}: {wording.bare(name)}"
            facts.append(
                Fact(
                    label[:1].upper() + label[1:], joined(value, unit), f"95 % interval {joined(ends, unit)}"
                )
            )
    low, high = verdict["band_hz"]
    count = len(tracing.before)
    facts.append(Fact("Trials", f"{count} cuts", f"compared from {number(low)} to {number(high)} Hz"))
    return facts


def _strength_first(tracing: Tracing, entry: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    kind = next((each for each in tracing.kinds if each.name == entry["name"]), None)
    strength = kind.strength if kind is not None else ""
    return sorted(entry["parameters"].items(), key=lambda item: item[0] != strength)


def _effects(tracing: Tracing) -> list[dict[str, Any]]:
    shown = []
    for entry in tracing.verdict["effects"]:
        runner_up, separates = entry["runner_up"], ""
        kind = next((each for each in tracing.kinds if each.name == entry["name"]), None)
        if runner_up is not None and kind is not None:
            separates = kind.confused_with.get(runner_up["name"], "")
        shown.append(
            {
                "name": wording.spoken(entry["name"]),
                "tied": any(entry["name"] in pair["names"] for pair in tracing.verdict["ambiguous"]),
                "gloss": wording.gloss(entry["name"]),
                "gain": percent(entry["heldout_gain"]),
                "error": percent(entry["gain_standard_error"]),
                "evidence": entry["evidence"],
                "runner_up": None
                if runner_up is None
                else (wording.spoken(runner_up["name"]), percent(runner_up["heldout_nrmse"])),
                "separates": separates,
            }
        )
    return shown


def _pictures(tracing: Tracing) -> dict[str, Picture | None]:
    """Every figure of the report with its caption; None where there is nothing to draw."""
    named = bool(tracing.verdict["effects"])
    after = "; blue: with what was named" if named else ""
    unit = "newtons" if tracing.dataset.sensor.units == "SI" else "the sensor's units"
    drawn = {
        "revolution": (
            figures.revolution_figure(tracing),
            f"Force on the tool over one revolution, in {unit}. All turns of a trial are laid over each "
            "other: the black line is their median, the grey band holds the middle 80 %. Orange, dashed: "
            f"the base model{after}; where a model's force changes along the trial, the median of its turns. "
            "The models were fitted to all trials; the errors above are those on trials left out.",
        ),
        "spectrum": (
            figures.spectrum_figure(tracing),
            "What each model leaves, by frequency in multiples of the spindle's, root mean square over the "
            f"trials. The numbers beside the lines are amplitudes in {unit}"
            + (", before → after." if named else ".")
            + " A line that stays above the level between the lines is force that no model here explains.",
        ),
        "trials": (
            figures.trials_figure(tracing),
            f"Error of every trial when it was held out ({advice.held_out_how(tracing)}). Grey marks: what "
            "sensor noise alone leaves of that trial.",
        ),
        "telling": (
            figures.telling_figure(tracing),
            "Amplitude of the measured lines (rings), both radial axes together, beside the models. Runout "
            "leaves a once-per-revolution line that does not grow with feed; unequal pitch or a broken "
            "tooth one that does.",
        ),
        "intervals": (
            figures.intervals_figure(tracing),
            "Bars: 95 % intervals relative to the estimate (dot). Ticks: fits with part of the trials "
            "left out. A bar that reaches 0 cannot be told from nothing; arrows: it goes on beyond the "
            "figure.",
        ),
    }
    drawn["isolability"] = (
        figures.isolability_figure(tracing),
        "How alike the marks of two effects are on these trials, after the base model was fitted again with "
        "each; the number behind a name is the part of its mark that survives that. A pair near 1 cannot be "
        "told apart by these trials, an effect near 0 cannot be shown by them.",
    )
    return {
        name: None if drawing is None else Picture.of(drawing, text)
        for name, (drawing, text) in drawn.items()
    }


def _round(index: int, each: Round | SlowRound) -> dict[str, Any]:
    rows = []
    for candidate in each.candidates:
        decision = candidate.decision
        if candidate is each.accepted:
            word = "named"
        elif decision.accepted:
            word = "passes, but another is better"
        else:
            word = "refused"
        rows.append(
            (
                wording.spoken(candidate.kind.name),
                percent(candidate.heldout.nrmse),
                _gain(decision.gain, decision.gain_standard_error),
                chance(decision.p_chance),
                word,
                "; ".join(decision.reasons) or "passes every test",
            )
        )
    marked = frozenset(i for i, candidate in enumerate(each.candidates) if candidate is each.accepted)
    columns = ("effect tried", "held-out error", "gain ± s.e., points", "p of chance", "decision", "reasons")
    numeric = frozenset({1, 2, 3})
    shown = max(_CANDIDATES_SHOWN, max(marked, default=0) + 1)
    split = len(rows) > shown + 2
    return {
        "number": index + 1,
        "before": percent(each.before.nrmse),
        "table": Table(columns, rows[:shown] if split else rows, numeric, marked, kind="named"),
        "rest": Table(columns, rows[shown:], numeric, kind="named") if split else None,
        "named": None if each.accepted is None else wording.spoken(each.accepted.kind.name),
        "runner_up": None if each.runner_up is None else wording.spoken(each.runner_up.kind.name),
    }


def _gain(gain: float, error: float) -> str:
    """Fall of the error in percentage points, with its standard error where there is one."""
    said = percent(gain).removesuffix("\u00a0%")
    return said if not math.isfinite(error) else f"{said} ± {100.0 * error:.1f}"


def _parameters(tracing: Tracing) -> Table:
    rows = []
    for each in estimates(tracing):
        value, ends, symbol = interval(each.value, each.low, each.high, each.unit)
        if each.held:
            ends = "held; these trials cannot determine it"
        elif each.whole:
            ends = "a whole number, found by trying each"
        rows.append(
            (
                each.label,
                each.meaning,
                quantity(each.base, each.unit),
                joined(value, symbol),
                ends if each.held or each.whole else joined(ends, symbol),
            )
        )
    return Table(("parameter", "", "base model", "final model", "95 % interval"), rows, frozenset({2, 3}))


def _dependences(tracing: Tracing) -> Table:
    old = {each.covariate: each for each in tracing.depends_before}
    new = {each.covariate: each for each in tracing.depends_after}
    names = [
        each.covariate
        for each in sorted(tracing.depends_after, key=lambda each: (not each.found, -each.share))
    ]
    names += [name for name in old if name not in new]
    rows, marked = [], set()
    for index, name in enumerate(names):
        first, last = old.get(name), new.get(name)
        if last is not None and last.found:
            marked.add(index)
        rows.append(
            (
                name,
                _share(first),
                chance(first.p_value) if first else "–",
                _share(last),
                chance(last.p_value) if last else "–",
                "yes" if last is not None and last.found else "no",
                (last or first).look_for if (last or first) is not None else "",  # type: ignore[union-attr]
            )
        )
    columns = (
        "depends on",
        "share before",
        "p before",
        "share after",
        "p after",
        "still there",
        "what to look for",
    )
    return Table(columns, rows, frozenset({1, 2, 3, 4}), frozenset(marked), kind="named")


def _share(found: Dependence | None) -> str:
    """Part of the energy that goes with a covariate; the rank correlation where trials were compared."""
    if found is None:
        return "–"
    return f"ρ² {found.share:.2f}" if found.covariate in _ACROSS else percent(found.share)


def _ambiguous(verdict: dict[str, Any]) -> Table | None:
    rows = [
        (" or ".join(map(wording.spoken, pair["names"])), number(pair["cosine"], 2), pair["separating_trial"])
        for pair in verdict["ambiguous"]
    ]
    return (
        Table(("cannot be told apart", "cosine", "what would separate them"), rows, frozenset({1}))
        if rows
        else None
    )


def _not_testable(verdict: dict[str, Any]) -> Table | None:
    rows = [(wording.spoken(each["name"]), each["needs"]) for each in verdict["not_testable"]]
    return Table(("effect", "these trials do not have"), rows) if rows else None


def _left_out(verdict: dict[str, Any]) -> Table | None:
    rows = [(each["file"], each["reason"]) for each in verdict["left_out"]]
    return Table(("file", "why it was left out"), rows, kind="files") if rows else None


def _trials(tracing: Tracing) -> Table:
    base, final = tracing.search.base.per_trial, tracing.final.per_trial
    rows = []
    for each, old, new in zip(subjects(tracing), base, final, strict=True):
        trial = each.trial
        rows.append(
            (
                str(each.number),
                trial.file,
                trial.milling or "",
                number(60.0 * each.before.speed_rev_s, 5),
                f"{1e3 * each.feed_per_tooth_m:.3g}",
                f"{1e3 * trial.radial_depth_m:.4g}",
                f"{1e3 * trial.axial_width_m:.4g}",
                percent(old),
                percent(new),
            )
        )
    columns = (
        "trial", "file", "cut", "speed, rpm", "feed, mm/tooth", "depth, mm", "width, mm",
        "error before", "error after",
    )  # fmt: skip
    return Table(columns, rows, frozenset({3, 4, 5, 6, 7, 8}), kind="trials")


def _tool(tracing: Tracing) -> str:
    tool = tracing.dataset.tool
    kind, edges = tool.kind.replace("_", " "), "tooth" if tool.teeth == 1 else "teeth"
    helix = f", helix {quantity(tool.helix_rad, 'rad')}" if tool.helix_rad else ""
    return f"{kind}, {tool.teeth} {edges}, diameter {quantity(tool.diameter_m, 'm')}{helix}"
