"""Beyond the paper: the expert adapted with the missing effect named, with a GP alone, and with both.

Steady cuts are recorded at the virtual cell (the effects hidden there are those of the evaluation's cell),
and traced. Then, as in `mjx-cutting loop`,

    gp_only         DAgger under the GP of everything the base model leaves of them (the paper's way)
    effect_only     fine-tuned by PPO with the named effect in the simulation
    effect_and_gp   that policy, then DAgger under the GP of what the effect leaves

Trials are of one sheet, since a force model has one sheet's constants; the policies are for all of them.
Where tracing names nothing there is no effect to add, and gp_only stands alone.
"""

from __future__ import annotations

import dataclasses
import json
import shutil
from pathlib import Path
from typing import Any

from experiments import adapt
from mjx_cutting import _files, runs

STRATEGIES = ("gp_only", "effect_only", "effect_and_gp")
TOLD = "traced.json"


def adapt_traced(
    config: adapt.Config, out: Path, expert: Path, effects: Path | None, sheet: str = "plastic"
) -> tuple[dict[str, Path], dict[str, Any]]:
    """Return the run folders by strategy, and what tracing found; complete stages are left as they are.

    Arguments:
        config: settings of the adaptation experiment.
        out: folder of the experiment.
        expert: run folder of the expert.
        effects: TOML file with the cell's hidden effects; None: the declared ones.
        sheet: on which the trials are recorded.

    Raises: ValueError when fewer than two recorded trials are steady.
    """

    def record(folder: Path, resume: Path | None) -> Path:
        return record_and_trace(config, folder, expert, effects, sheet)

    traced = adapt.stage(out / "traced", record)
    told = json.loads((traced / TOLD).read_text())
    model = traced / "trace" / "model.json"

    def run(name: str, strategy: str, start: Path, gp: Path | None, **changed: Any) -> Path:
        settings = dataclasses.replace(config, **changed)
        return adapt.stage(
            out / name,
            lambda folder, resume: adapt.adapt_expert(settings, strategy, start, gp, folder, resume),
        )

    folders = {"gp_only": run("gp_only", "dagger", expert, traced / "gp_before.npz")}
    if told["named"]:
        folders["effect_only"] = run(
            "effect_only", "fine_tune", expert, None, model=model, fine_tune=config.refine
        )
        start, rest = folders["effect_only"], traced / "gp_after.npz"
        folders["effect_and_gp"] = run("effect_and_gp", "dagger", start, rest, model=model)
    return folders, told


def record_and_trace(
    config: adapt.Config, folder: Path, expert: Path, effects: Path | None, sheet: str
) -> Path:
    """Record steady cuts at the cell, trace them, fit the two GPs, and write what was found; the folder."""
    from mjx_cutting.deploy.export import build_run
    from mjx_cutting.deploy.virtual_cell import Cell
    from mjx_cutting.loop import rounds, rounds_record
    from mjx_cutting.loop.cell_cut import cell_config
    from mjx_cutting.loop.cell_domain import hidden_effects
    from mjx_cutting.loop.transfer import fit_rest
    from mjx_cutting.tracing import save, trace

    shutil.rmtree(folder, ignore_errors=True)  # what an interrupted recording left
    place = dataclasses.replace(
        cell_config(config.env, sheet, config.seed), approach_m=0.005, cut_m=rounds_record.PROBE_CUT_M
    )
    probes = rounds_record.probes(build_run(expert, allow_failed_check=True), 9, config.seed)
    cell = Cell(place, hidden_effects(effects))
    rounds_record.record(cell, probes, folder / "trials", f"{sheet}, for the paper's experiment")
    dataset = rounds_record.merged([folder / "trials"], config.env.surface_height_m, rounds.MOST_TRIALS)
    tracing = trace(dataset, band_hz=rounds.BAND_HZ, effects=rounds.CANDIDATES, seed=config.seed)
    save(tracing, folder / "trace")
    fit_rest(tracing.before, config.env, folder / "gp_before.npz")
    fit_rest(tracing.after, config.env, folder / "gp_after.npz")
    verdict = tracing.verdict
    told = {
        "sheet": sheet,
        "trials": len(tracing.before),
        "named": [each["name"] for each in verdict["effects"]],
        "verdict": verdict["verdict"],
        "heldout_nrmse_before": verdict["before"]["heldout_nrmse"],
        "heldout_nrmse_after": verdict["after"]["heldout_nrmse"],
    }
    _files.write_atomic(folder / TOLD, json.dumps(runs.plain(told), indent=1) + "\n")
    return folder
