"""report.html of the demo: what was found, trained, adapted and exported, with figures and settings."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np

from mjx_cutting import _platform, runs
from mjx_cutting._report.page import Code, Fact, Listing, Paragraph, Picture, Section, Table, render_page
from mjx_cutting._report.quantities import number, percent
from mjx_cutting.evaluation import figures as drawn
from mjx_cutting.evaluation import metrics
from mjx_cutting.evaluation.statistics import welch
from mjx_cutting.learning.progress import read_lines
from mjx_cutting.tracing.report import wording
from mjx_cutting.tracing.report.figures.revolution import revolution_figure
from mjx_cutting.tracing.report.figures.spectrum import spectrum_figure
from mjx_cutting.tracing.report.figures.trials import trials_figure

if TYPE_CHECKING:
    from mjx_cutting.loop.demo import Outcome

_DOMAINS = {"source": "clean simulation", "surrogate": "disturbed simulation"}
_MEASURES = (
    ("reward", "reward"),
    ("time_s", "time, s"),
    ("path_deviation_mm", "path deviation, mm"),
    ("load_n", "load, N"),
    ("mrv_mm3", "removed volume, mm³"),
    ("completed", "completed"),
)


def render(outcome: Outcome) -> str:
    """The page of one demo."""
    verdict = outcome.tracing.verdict
    reward = {domain: _rewards(outcome, domain) for domain in outcome.results}
    return render_page(
        "One turn of the loop: from measured forces to an exported policy",
        [
            _traced(outcome),
            _trained(outcome, reward["source"]),
            _disturbed(outcome),
            _compared(outcome, reward),
            _exported(outcome),
            _settings(outcome),
        ],
        lead=_lead(outcome, reward),
        tag=verdict["verdict"],
        tone=wording.TONES[verdict["verdict"]],
        facts=[
            Fact(
                "force error on held-out trials",
                percent(verdict["after"]["heldout_nrmse"]),
                old=percent(verdict["before"]["heldout_nrmse"]),
            ),
            Fact(
                "reward on clean simulation",
                number(reward["source"]["expert"].mean()),
                "the expert's, after the untrained policy's",
                old=number(reward["source"]["untrained"].mean()),
            ),
            Fact(
                "exported policy against JAX",
                number(outcome.exported["difference"]),
                "largest difference of an action in [-1, 1]",
            ),
            Fact("wall-clock time", f"{sum(outcome.seconds.values()):.0f} s"),
        ],
        about=f"mjx-cutting {_platform.versions()['mjx-cutting']}, run folder {outcome.folder.name}, "
        f"seed {outcome.config.seed}.",
    )


def _lead(outcome: Outcome, reward: dict[str, dict[str, np.ndarray]]) -> str:
    data = "Measured" if outcome.measured else "Calculated (no measured ones were at hand)"
    better = reward["source"]["expert"].mean() > reward["source"]["untrained"].mean()
    trained = "beats" if better else "does not beat"
    return (
        f"{data} trials: {' '.join(wording.finding(outcome.tracing))} In the simulation with what was found, "
        f"the expert {trained} the policy it was trained from."
    )


def _traced(outcome: Outcome) -> Section:
    tracing = outcome.tracing
    blocks: list[Any] = []
    if not outcome.measured:
        blocks.append(
            Paragraph(
                f"The measured slotting trials could not be had: {outcome.why} What follows is shown on "
                "trials made by the package's own calculation, with a runout of 11 um put in.",
                tone="warning",
            )
        )
    blocks += [
        Paragraph(f"{tracing.dataset.name}: {tracing.dataset.source or 'source not stated'}.", tone="note"),
        Picture.of(revolution_figure(tracing), "Measured against predicted force over one revolution."),
        Picture.of(spectrum_figure(tracing), "What the model leaves, by spindle order."),
        Picture.of(trials_figure(tracing), "Error on each trial while it was held out of the fit."),
        Paragraph("The whole tracing stands in trace/report.html, verdict.json and model.json.", tone="note"),
    ]
    return Section("1. What the force model lacked", blocks)


def _trained(outcome: Outcome, reward: dict[str, np.ndarray]) -> Section:
    lines = read_lines(outcome.folder / "expert" / "metrics.jsonl")
    told = [line for line in lines if line.get("episode_return") is not None]
    steps = np.array([line["steps"] for line in told], float)
    values = np.array([line["episode_return"] for line in told], float)
    blocks: list[Any] = []
    if len(told) > 1:
        curve = drawn.training_curves({"expert": (steps, values)}, smooth=5)
        blocks.append(Picture.of(curve, "Mean reward of the episodes that ended, against policy steps."))
    expert, untrained = reward["expert"], reward["untrained"]
    test = welch(expert, untrained)
    blocks.append(
        Paragraph(
            f"On {len(expert)} episodes never seen in training the expert's reward is {expert.mean():.2f}, "
            f"the untrained policy's {untrained.mean():.2f} "
            f"(Welch's t test, two-tailed, p = {test.p_value:.2g})."
        )
    )
    return Section("2. The expert", blocks)


def _disturbed(outcome: Outcome) -> Section:
    return Section(
        "3. What stays unexplained, as a disturbance",
        [
            Paragraph(
                "The residual of the final model is taken against the spindle angle, replayed at the saw's "
                "speed and scaled to the paper's mean load; one periodic Gaussian process is fitted to all "
                "trials and one function of it is drawn an episode, at a random phase."
            ),
            Picture.of(
                _disturbance_figure(outcome), "Residual trials, the process' mean and its 2-sigma band."
            ),
        ],
    )


def _disturbance_figure(outcome: Outcome) -> Any:
    from matplotlib.figure import Figure

    time, trials = outcome.replay
    shown = time < 3.0 * outcome.disturbance.period_s
    mean, deviation = outcome.disturbance.predict(time[shown])
    figure = Figure(figsize=(9.0, 2.8), layout="constrained")
    for axis, axes in enumerate(figure.subplots(1, 3, sharey=True)):
        x = 1e3 * time[shown]
        axes.plot(x, trials[:, shown, axis].T, color="0.6", lw=0.6)
        axes.plot(x, mean[:, axis], color="#0072b2", lw=1.4)
        low, high = mean[:, axis] - 2 * deviation[:, axis], mean[:, axis] + 2 * deviation[:, axis]
        axes.fill_between(x, low, high, color="#0072b2", alpha=0.2, lw=0)
        axes.set(title=f"force {'xyz'[axis]}", xlabel="time, ms")
        axes.grid(alpha=0.3)
    figure.axes[0].set_ylabel("residual force, N")
    return figure


def _compared(outcome: Outcome, reward: dict[str, dict[str, np.ndarray]]) -> Section:
    blocks: list[Any] = []
    for domain, title in _DOMAINS.items():
        rows = []
        for name, rollouts in outcome.results[domain].items():
            measures = metrics.episodes(rollouts)
            rows.append([name, *(_mean(measures[key]) for key, _ in _MEASURES)])
        blocks.append(
            Table(
                ["strategy", *(label for _, label in _MEASURES)],
                rows,
                numeric=frozenset(range(1, len(_MEASURES) + 1)),
                caption=f"Means over {outcome.config.rollouts} episodes, {title}",
            )
        )
    named = {_DOMAINS[domain]: rewards for domain, rewards in reward.items()}
    blocks.append(Picture.of(drawn.violins(named), "Reward of every episode; all strategies face the same."))
    pair = {name: outcome.results["surrogate"][name] for name in ("expert", "adapted")}
    description = outcome.policies["expert"].description
    blocks.append(
        Picture.of(
            drawn.over_time(pair, description),
            "Set-points and states over time on the disturbed simulation: mean and 10 to 90 % band.",
        )
    )
    return Section("4. Expert and adapted policy", blocks)


def _exported(outcome: Outcome) -> Section:
    exported = outcome.exported
    return Section(
        "5. The exported policy",
        [
            Paragraph(
                f"policy.npz, run by the NumPy runtime in closed loop on the disturbed simulation: "
                f"{exported['steps']} steps, reward {exported['reward']:.2f}; its actions differ from JAX's "
                f"by at most {exported['difference']:.1e} of a range of 2."
            )
        ],
    )


def _settings(outcome: Outcome) -> Section:
    resolved = {"demo": outcome.config, "env": outcome.env, "versions": _platform.versions()}
    return Section(
        "Settings and times",
        [
            Listing([f"{name}: {seconds:.1f} s" for name, seconds in outcome.seconds.items()]),
            Code(json.dumps(runs.plain(resolved), indent=2)),
        ],
        folded=True,
    )


def _rewards(outcome: Outcome, domain: str) -> dict[str, np.ndarray]:
    return {name: each.total("reward") for name, each in outcome.results[domain].items()}


def _mean(values: np.ndarray) -> str:
    finite = values[np.isfinite(values)]
    return number(float(finite.mean())) if finite.size else "-"
