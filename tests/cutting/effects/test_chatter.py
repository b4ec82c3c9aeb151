"""Regenerative chatter against published stability limits, through the model's own time steps."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from mjx_cutting.cutting import Cut, ForceModel, Material, Tool, effect_class
from tests.optimised import OPTIMISED

pytestmark = pytest.mark.usefixtures("float64")

# One mode along the feed: 922 Hz, damping .011, mass .03993 kg; N = 2, slot, K_t 6e8 and K_n 2e8 N/m^2.
# Limit depth in mm and the kind of instability by collocation, at each speed in rpm.
FREQUENCY, DAMPING, MASS = 922.0, 0.011, 0.03993
LIMITS = {
    5000: (0.40863, "Hopf"),
    8000: (0.67639, "Hopf"),
    10000: (0.32238, "Hopf"),
    12000: (2.14931, "flip"),
    15000: (0.38659, "Hopf"),
    20000: (1.41751, "flip"),
    25000: (3.93993, "Hopf"),
}
STEPS = 320
# so large a feed that no wave lets a tooth leave the sheet: the motion about the steady one is then linear
HUGE_FEED_PER_TOOTH_M = 1.0


def model(*more: Any, compliance: float = 1.0) -> ForceModel:
    stiffness = MASS * (2.0 * np.pi * FREQUENCY) ** 2
    chatter = effect_class("regenerative_chatter")(
        jnp.array([compliance / stiffness, 0.0]), jnp.full(2, FREQUENCY), jnp.full(2, DAMPING)
    )
    return ForceModel(Tool("end_mill", 2, 0.01), Material(6e8, 0.0, 2e8, 0.0), (chatter, *more))


def cut(depth_mm: Any, rpm: float, feed_m: float = HUGE_FEED_PER_TOOTH_M) -> Cut:
    speed = rpm / 60.0
    return Cut(0.0, speed, feed_m * 2.0 * speed, 0.01, depth_mm * 1e-3, 0.0, np.pi)


def multipliers(depth_mm: float, rpm: float, the_model: ForceModel | None = None) -> np.ndarray:
    """Floquet multipliers over one tooth period: eigenvalues of the slope of state after in state before."""
    the_model = model() if the_model is None else the_model
    period = 1.0 / (2.0 * rpm / 60.0)
    start = the_model.init()
    rest = start[1:]

    def after(reduced: jax.Array) -> jax.Array:
        response = start[0][0].at[:, 0].set(reduced[:2])
        past = start[0][1].at[: STEPS + 1, 0].set(reduced[2:])
        state, _, _ = the_model.step(((response, past), *rest), cut(depth_mm, rpm), period, STEPS)
        return jnp.concatenate([state[0][0][:, 0], state[0][1][: STEPS + 1, 0]])

    slope = jax.jit(jax.jacfwd(after), compiler_options=OPTIMISED)(jnp.zeros(STEPS + 3))
    return np.linalg.eigvals(np.asarray(slope))


def check(rpm: int) -> None:
    limit, kind = LIMITS[rpm]
    below, above = (multipliers(share * limit, rpm) for share in (0.98, 1.02))
    assert np.abs(below).max() < 1.0 < np.abs(above).max()
    worst = above[np.argmax(np.abs(above))]
    if kind == "flip":  # real and negative: the wave repeats every second tooth, at exactly f_t / 2
        assert abs(worst.imag) < 1e-6 and worst.real < -1.0
    else:
        assert abs(worst.imag) > 0.05


def test_limit_at_12000_rpm_within_2_percent():
    check(12000)


@pytest.mark.slow
@pytest.mark.parametrize("rpm", [rpm for rpm in LIMITS if rpm != 12000])
def test_limits_within_2_percent(rpm: int):
    check(rpm)


def record(depth_mm: float, rpm: float, turns: int) -> np.ndarray:
    """[steps, 3] force at a real feed, the wave free to grow until teeth leave the sheet."""
    the_model = model()
    speed = rpm / 60.0
    steps = 320 * turns
    time = jnp.arange(steps) / (speed * 320)
    here = cut(depth_mm, rpm, 1e-4).replace(angle_rad=2.0 * jnp.pi * speed * time, time_s=time)
    return np.asarray(
        jax.jit(ForceModel.predict, compiler_options=OPTIMISED)(the_model, here, 1.0 / (speed * 320))
    )


def test_chatter_grows_to_lines_off_the_spindle_and_stays_bounded():
    """Above the limit: lines at f_c + k f_t that are no multiple of f_s; below: multiples of f_t only."""
    rpm, turns = 10000, 120
    strong = {}
    for share in (0.6, 1.6):
        force = record(share * LIMITS[rpm][0], rpm, turns)[-320 * 60 :, 0]
        spectrum = np.abs(np.fft.rfft(force * np.hanning(len(force))))
        order = np.arange(len(spectrum)) / 60.0
        teeth = np.abs(order / 2.0 - np.round(order / 2.0)) * 2.0 < 0.06
        strong[share] = spectrum[~teeth].max() / spectrum[teeth].max()
        assert np.isfinite(force).all()
    assert strong[0.6] < 0.01
    assert strong[1.6] > 0.1


@pytest.mark.parametrize("times", [8.0])
def test_chatter_saturates_however_deep_the_cut(times: float):
    """Passes further back hold the wave: it stops growing, and the mean chip is still what is fed."""
    the_model, rpm, steps, turns, feed = model(), 10000, 80, 120, 1e-4
    depth = times * LIMITS[rpm][0]
    speed = rpm / 60.0
    time = jnp.arange(2 * steps * turns) / (speed * 2 * steps)
    here = cut(depth, rpm, feed).replace(angle_rad=2.0 * jnp.pi * speed * time, time_s=time)
    force = np.asarray(
        jax.jit(ForceModel.predict, compiler_options=OPTIMISED)(the_model, here, 1.0 / (speed * 2 * steps))
    )[:, :2]
    early, late = force[len(force) // 3 : 2 * len(force) // 3], force[2 * len(force) // 3 :]
    assert np.abs(late).max() < 1.2 * np.abs(early).max() < 20.0 * 6e8 * depth * 1e-3 * feed
    # a slot's mean force in y is N b K_t c / 4, whatever is left standing by one tooth another takes
    np.testing.assert_allclose(late[:, 1].mean(), 2 * depth * 1e-3 * 6e8 * feed / 4, rtol=0.1)


def test_a_rigid_tool_does_not_chatter():
    force = [
        np.asarray(jax.jit(ForceModel.step)(m, m.init(), cut(0.5, 10000, 1e-4), 1e-3)[1])
        for m in (model(compliance=0.0), ForceModel(model().tool, model().material))
    ]
    np.testing.assert_allclose(force[0], force[1], rtol=1e-9)


def test_process_damping_calms_and_less_so_at_high_speed():
    """The same damper takes more off the largest multiplier at 5000 than at 10000 rpm, per time."""
    damper = effect_class("process_damping")(2e4)
    calmed = []
    for rpm in (5000, 10000):
        depth = LIMITS[rpm][0]
        plain, damped = (np.abs(multipliers(depth, rpm, m)).max() for m in (model(), model(damper)))
        rate = 2.0 * rpm / 60.0
        calmed.append(rate * (np.log(plain) - np.log(damped)) / depth)
    assert calmed[0] > 1.5 * calmed[1] > 0.0


def test_a_tooth_period_beyond_the_memory_is_not_answered_wrongly():
    the_model = model()
    _, process, _ = jax.jit(ForceModel.step)(the_model, the_model.init(), cut(0.5, 60), 1e-4)
    assert np.isnan(np.asarray(process)).any()
