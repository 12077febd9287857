"""Effects with a history, wall blockage, and laws beyond ground effect."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.core.rig_file import load_rig_by_name
from benchtool.physics.bases import ground_effect_ratio
from benchtool.physics.conditions import Conditions, past_means, plate_moves
from benchtool.physics.effects.effect import HISTORY_TIME_CONSTANTS_S
from benchtool.physics.model import Model

TIME_S = np.array([0.0, 10.0, 20.0, 40.0, 50.0, 70.0])
Z_M = np.array([0.2, 0.2, np.nan, 0.1, 0.1, 0.3])
POSITION = np.array([Z_M, np.zeros(6), np.zeros(6)])


def test_a_plate_moves_half_way_between_two_points_in_a_direction():
    since_s, direction = plate_moves(TIME_S, POSITION)
    assert since_s.tolist() == [0.0, 10.0, 20.0, 10.0, 20.0, 10.0]
    assert direction.tolist() == [0.0, 0.0, 0.0, -1.0, -1.0, 1.0]


def test_points_can_be_in_any_order():
    order = np.array([3, 0, 5, 1, 4, 2])
    for shuffled, ordered in zip(
        plate_moves(TIME_S[order], POSITION[:, order]), plate_moves(TIME_S, POSITION), strict=True
    ):
        assert shuffled.tolist() == ordered[order].tolist()


def test_a_past_mean_is_a_low_pass_filter():
    time_s = np.arange(0.0, 600.0, 2.0)
    means = past_means(time_s, time_s, np.where(time_s < 300.0, 1.0, 0.0))
    for mean, time_constant_s in zip(means, HISTORY_TIME_CONSTANTS_S, strict=True):
        assert mean[149] == pytest.approx(1.0 - np.exp(-298.0 / time_constant_s), abs=1e-9)
        assert mean[160] == pytest.approx(mean[149] * np.exp(-22.0 / time_constant_s), abs=1e-9)


def test_motors_are_stopped_while_the_plate_moves():
    time_s = np.array([0.0, 2.0, 4.0, 104.0])
    moved_s = np.array([0.0, 2.0, 4.0, 50.0])
    means = past_means(time_s, moved_s, np.ones(4))
    mean = 1.0 - np.exp(-4.0 / 10.0)
    assert means[0, 2] == pytest.approx(mean)
    expected = 1.0 + (mean * np.exp(-98.0 / 10.0) - 1.0) * np.exp(-2.0 / 10.0)
    assert means[0, 3] == pytest.approx(expected)


RIG = load_rig_by_name("pquad_single")
RADIUS_M = RIG.propulsion.radius_m


def thrust_loss(z_over_R: float, coverage: float = 1.0) -> float:
    """Return the relative thrust loss by a stand with a download of 10 %."""
    bare = Model.single(RIG)
    conditions = Conditions.build(
        RIG,
        speed_rad_s=np.array([400.0]),
        plate_z_m=np.array([z_over_R * RADIUS_M]),
        coverage=np.array([[coverage]]),
    )
    with_stand = bare.with_effect("wall_blockage", share=0.1)
    return float(1.0 - with_stand.thrust_N(conditions)[0] / bare.thrust_N(conditions)[0])


@pytest.mark.parametrize(
    ("z_over_R", "ratio"), [(0.5, 0.26003), (1.0, 0.55119), (2.0, 0.83489), (4.0, 0.97766)]
)
def test_download_near_the_plate_is_leishmans_formula(z_over_R, ratio):
    """Computed by hand: 1 - 1.22 exp(-z/R)."""
    assert thrust_loss(z_over_R) == pytest.approx(0.1 * ratio, rel=1e-4)


def test_download_without_coverage_does_not_recover():
    assert thrust_loss(0.5, coverage=0.0) == pytest.approx(0.1)
    assert thrust_loss(0.5, coverage=0.5) == pytest.approx(0.5 * (0.1 + thrust_loss(0.5)), rel=0.1)


def test_rotor_interaction_needs_running_neighbours():
    rig = load_rig_by_name("pquad")
    model = Model.single(rig).with_effect("rotor_interaction", share=0.02, reach=0.3)
    k = model.parameters["k"].value
    far = {"plate_z_m": [1e6], "coverage": np.zeros((4, 1))}
    alone = Conditions.build(rig, speed_rad_s=[500.0, 0.0, 0.0, 0.0], **far)
    together = Conditions.build(rig, speed_rad_s=[500.0] * 4, **far)
    assert model.thrust_N(alone)[0] == pytest.approx(k * 500.0**2, rel=1e-12)
    distances = rig.disc_distances_m[0, 1:] / (2.0 * rig.propulsion.radius_m)
    loss = 0.02 * np.exp(-(distances - 1.0) / 0.3).sum()
    assert model.thrust_N(together)[0] == pytest.approx(4.0 * k * 500.0**2 * (1.0 - loss))


def test_recirculation_takes_seven_per_cent_at_two_and_a_half_radii():
    rig = load_rig_by_name("pquad_single")
    bare, model = Model.single(rig), Model.single(rig).with_effect("recirculation", share=0.07)
    z_m = np.array([0.5, 1.5, 2.5, 4.0, 60.0]) * rig.propulsion.radius_m
    conditions = Conditions.build(rig, speed_rad_s=[500.0], plate_z_m=z_m, coverage=np.ones((1, 5)))
    ratio = model.thrust_N(conditions) / bare.thrust_N(conditions)
    assert ratio[2] == pytest.approx(0.93)
    assert np.all(ratio[[0, 1, 3]] > 0.93)
    assert ratio[4] == pytest.approx(1.0, abs=1e-6)


def test_forward_speed_reduces_ground_effect_as_in_the_source():
    rig = load_rig_by_name("pquad_single")
    model = Model.single(rig).with_effect("forward_speed", strength=1.0, hover_inflow_m_s=5.0)
    speeds = np.array([0.0, 2.0, 5.0, 20.0])
    z_m = np.full(4, rig.propulsion.radius_m)
    moving = Conditions.build(rig, speed_rad_s=[500.0], plate_z_m=z_m, airspeed_m_s=speeds)
    inflow = np.sqrt(
        [next(v.real for v in np.roots([1.0, V**2, -(5.0**4)]) if v.real > 0) for V in speeds]
    )
    expected = 1.0 / (1.0 - (1.0 / 16.0) / (1.0 + (speeds / inflow) ** 2))
    np.testing.assert_allclose(
        ground_effect_ratio(model, "equal_rpm2", moving), expected, rtol=1e-12
    )
    assert expected[0] == pytest.approx(16.0 / 15.0)
    assert expected[-1] < 1.001
