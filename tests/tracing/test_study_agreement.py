"""Two codes apart give one force: the simulator's records against `ForceModel.predict`, effects combined."""

from __future__ import annotations

import jax
import numpy as np
import pytest
from scipy import signal

from benchmarks.study import make
from mjx_cutting.cutting import Cut, ForceModel, Material, Tool, effect_class

FINE_HZ, SETTLE = 16_000.0, 4_800
CLIMB = 4


def predicted(case, trial, seconds: float) -> np.ndarray:
    """The library's force with the true parameters on a fine grid, through the declared filter, sampled."""
    tool, told = case.dataset.tool, case.truth["trials"][trial.file]
    factor = round(FINE_HZ / case.dataset.sensor.sample_rate_hz)
    time = (np.arange(round(seconds * FINE_HZ) + SETTLE) - SETTLE) / FINE_HZ
    effects = tuple(effect_class(name)(**values) for name, values in case.truth["effects"].items())
    model = ForceModel(
        Tool(tool.kind, tool.teeth, tool.diameter_m), Material(**case.truth["material"]), effects
    )
    place = trial.feed_speed_m_s * time
    cut = Cut.milling(
        trial.milling, tool.diameter_m,
        angle_rad=told["phase_rad"] + 2.0 * np.pi * told["speed_rev_s"] * time,
        spindle_speed_rev_s=told["speed_rev_s"], feed_speed_m_s=trial.feed_speed_m_s,
        radial_depth_m=trial.radial_depth_m, axial_width_m=trial.axial_width_m, position_m=place,
        cut_length_m=trial.cut_length_before_m + place, time_s=time,
        gate_rad=2.0 * np.pi * told["speed_rev_s"] / FINE_HZ,
    )  # fmt: skip
    force = np.asarray(jax.jit(lambda each: model.predict(each, 1.0 / FINE_HZ))(cut))
    alias = case.dataset.sensor.anti_alias
    sections = signal.butter(alias.order, alias.hz, fs=FINE_HZ, output="sos")
    return signal.sosfilt(sections, force, axis=0)[SETTLE::factor] + told["bias_n"]


@pytest.mark.parametrize(
    ("effects", "within", "seed"),
    [
        (("radial_runout", "size_effect", "material_periodicity", "robot_mode", "crosstalk"), 2e-3, 3),
        (("broken_tooth", "flank_wear", "clamp_mode", "sensor_resonance"), 2e-3, 3),
        (("ploughing", "static_compliance", "layered_material", "entry_exit", "side_friction"), 5e-3, 3),
        (("static_compliance",), 1.5e-3, CLIMB),
    ],
)
def test_the_force_path_and_the_simulator_agree(effects, within, seed):
    strength = {name: "strong" if name == "broken_tooth" else "medium" for name in effects}
    case = make("saw", strength, seed, noise=1e-9)
    plain = make("saw", {}, seed, noise=1e-9).dataset
    assert (case.dataset.trials[0].milling == "climb") == (seed == CLIMB)
    with jax.enable_x64(True):
        trial, bare = case.dataset.trials[0], plain.trials[0]
        theirs = predicted(case, trial, 1.0)
    ours = trial.force_n[: len(theirs)]
    size = np.sqrt(np.mean(ours**2))
    assert np.sqrt(np.mean((theirs - ours) ** 2)) < within * size
    assert np.sqrt(np.mean((bare.force_n - trial.force_n) ** 2)) > 20.0 * within * size
