"""Mean cutting forces against closed forms and published figures."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from mjx_cutting.cutting import Cut, ForceModel, Material, Tool, revolution

pytestmark = pytest.mark.usefixtures("float64")

wave_of = jax.jit(revolution, static_argnums=2)
ANGLES = 7200
TEETH, WIDTH_MM, CHIP_MM = 4, 2.0, 0.05
K_TC, K_RC, K_TE, K_RE, K_AC, K_AE = 796.0, 168.8, 27.7, 30.8, 222.0, 1.4
REFERENCE = {
    (0.0, np.pi): (-95.3116, 150.1375, 212.1499),
    (0.0, np.pi / 2): (-108.2620, 30.4799, 106.0749),
    (np.pi / 2, np.pi): (12.9504, 119.6576, 106.0749),
}


def reference_model() -> ForceModel:
    tool = Tool("end_mill", TEETH, 0.02)
    return ForceModel(tool, Material.from_n_mm(K_TC, K_TE, K_RC, K_RE, K_AC, K_AE))


def reference_cut(entry: float, exit_: float, chip_mm: float = CHIP_MM) -> Cut:
    speed = 50.0
    return Cut(0.0, speed, chip_mm * 1e-3 * TEETH * speed, 0.01, WIDTH_MM * 1e-3, entry, exit_)


@pytest.mark.parametrize("arc_rad", REFERENCE, ids=["slot", "first half", "second half"])
def test_mean_force_of_three_arcs(arc_rad: tuple[float, float]):
    model, cut = reference_model(), reference_cut(*arc_rad)
    mean = np.asarray(wave_of(model, cut, ANGLES).mean(axis=0))
    x, y, tangential = REFERENCE[arc_rad]
    np.testing.assert_allclose(mean[:2], [x, y], atol=2e-4)
    angle = 2.0 * np.pi / ANGLES * np.arange(ANGLES)
    torque = jax.jit(ForceModel.torque_z)(
        model, cut.replace(angle_rad=angle, gate_rad=2.0 * np.pi / ANGLES)
    ).mean()
    np.testing.assert_allclose(torque / 0.01, tangential, atol=2e-4)


def test_slot_closed_form_on_all_axes():
    mean = np.asarray(wave_of(reference_model(), reference_cut(0.0, np.pi), ANGLES).mean(axis=0))
    share = TEETH * WIDTH_MM
    expected = [
        -share / 4 * K_RC * CHIP_MM - share / np.pi * K_RE,
        share / 4 * K_TC * CHIP_MM + share / np.pi * K_TE,
        -share / np.pi * K_AC * CHIP_MM - share / 2 * K_AE,
    ]
    np.testing.assert_allclose(mean, expected, rtol=1e-6)


def test_a_wrong_unit_of_speed_would_be_seen():
    """The chip is feed over teeth and REVOLUTIONS per second: rad/s would lose a factor 2 pi."""
    cut = reference_cut(0.0, np.pi).replace(angle_rad=np.pi / 2)
    thickness = reference_model().chip(cut).thickness_m
    np.testing.assert_allclose(np.max(np.asarray(thickness)), CHIP_MM * 1e-3, rtol=1e-12)


FEEDS_MM = np.array([0.025, 0.05, 0.1, 0.15, 0.2])
MEAN_X = np.array([-69.4665, -88.1012, -105.6237, -118.1107, -130.6807])
MEAN_Y = np.array([64.3759, 99.1383, 155.7100, 210.4644, 263.4002])


@pytest.mark.parametrize(
    ("measured", "axis", "chip", "edge", "r2"),
    [(MEAN_X, 0, 221.09, 35.38, 0.961), (MEAN_Y, 1, 751.63, 21.07, 0.9986)],
    ids=["feed axis", "normal axis"],
)
def test_regression_of_published_mean_forces(
    measured: np.ndarray, axis: int, chip: float, edge: float, r2: float
):
    """Constants fitted through the model's own linear response to each constant, slot, N = 4, 1.5 mm."""
    tool = Tool("end_mill", 4, 0.02)

    def mean(material: Material, feed_mm: float) -> float:
        cut = Cut(0.0, 50.0, feed_mm * 1e-3 * 4 * 50.0, 0.01, 1.5e-3, 0.0, np.pi)
        return float(wave_of(ForceModel(tool, material), cut, 1440).mean(axis=0)[axis])

    units = [(0, 0, 1, 0), (0, 0, 0, 1)] if axis == 0 else [(1, 0, 0, 0), (0, 1, 0, 0)]
    design = np.array([[mean(Material.from_n_mm(*unit), feed) for unit in units] for feed in FEEDS_MM])
    found, squares, *_ = np.linalg.lstsq(design, measured, rcond=None)
    np.testing.assert_allclose(found, [chip, edge], atol=0.006)
    spread = np.sum((measured - measured.mean()) ** 2)
    assert 1.0 - squares[0] / spread == pytest.approx(r2, abs=6e-4)


def test_mean_over_time_equals_mean_over_angle():
    model = reference_model()
    speed, rate = 50.0, 50.0 * 3600
    time = np.arange(3600) / rate
    cut = reference_cut(0.0, np.pi / 2).replace(
        angle_rad=2.0 * np.pi * speed * time, time_s=time, gate_rad=2.0 * np.pi / 3600
    )
    in_time = jax.jit(ForceModel.predict)(model, cut, 1.0 / rate).mean(axis=0)
    in_angle = wave_of(model, reference_cut(0.0, np.pi / 2), 3600).mean(axis=0)
    np.testing.assert_allclose(in_time, in_angle, rtol=1e-9)
    assert jnp.all(jnp.abs(in_time[:2]) > 1.0)
