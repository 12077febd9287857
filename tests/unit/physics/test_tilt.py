"""Images under tilt against the method of images with vectors, and invariants under tilt."""

from dataclasses import replace

import numpy as np
import pytest

from benchtool.core.errors import UnknownChoice
from benchtool.core.rig_file import load_rig_by_name
from benchtool.physics.bases import ground_effect_ratio
from benchtool.physics.catalogue import EFFECTS
from benchtool.physics.conditions import Conditions
from benchtool.physics.images import TILT_RULES, partial_factor
from benchtool.physics.model import OWN_IMAGES, Model
from benchtool.physics.model_file import load_model, model_from_toml, model_to_toml
from benchtool.physics.precomputed import PrecomputedModel
from tests.unit.physics.general_sum import multirotor_factors

RIG = load_rig_by_name("pquad")
POSITIONS, SPACING_M = RIG.disc_positions_m, float(RIG.disc_distances_m[0, 1])
TILTED = np.radians(10.0)


def quad(rule: str = "axis", **changes: str) -> Model:
    """Return eq. (4) with K_b = 2 under a tilt rule."""
    return replace(load_model("quad_body_lift").model, tilt_rule=rule, **changes)


def over(z_m: float, tilt_rad: float, coverage: tuple[float, ...] = (1.0,) * 4) -> Conditions:
    """Return conditions with a plate at distance z from the body's centre, along the normal."""
    return Conditions.build(
        RIG,
        speed_rad_s=np.full(4, 550.0),
        plate_z_m=np.array([z_m / np.cos(tilt_rad)]),
        plate_tilt_rad=tilt_rad,
        coverage=np.array(coverage)[:, None],
    )


def factors(model: Model, conditions: Conditions) -> np.ndarray:
    values = model.parameters.values_array()
    return np.ravel(model.disc_factors(model.flow(conditions, values), values))


@pytest.mark.parametrize(
    ("rule", "printed"),
    [
        ("axis", ["1.1652", "1.1501", "1.1404"]),
        ("vertical", ["1.1655", "1.1542", "1.1468"]),
        ("own_height", ["1.2031", "1.1528", "1.1185"]),
    ],
)
def test_factors_of_the_notes_at_ten_degrees(rule, printed):
    front, left, rear, right = factors(quad(rule), over(0.24, TILTED))
    assert [f"{value:.4f}" for value in (front, left, rear)] == printed
    assert right == pytest.approx(left, rel=1e-15)


@pytest.mark.parametrize("coverage", [(1.0,) * 4, (1.0, 0.6, 0.1, 0.3)])
@pytest.mark.parametrize("b_rule", ["half_diagonal", "diagonal"])
@pytest.mark.parametrize("rule", ["axis", "vertical"])
def test_it_is_the_method_of_images_with_vectors(rule, b_rule, coverage):
    weight = max(0.0, (sum(coverage) - 1.0) / 3.0)
    for z_m, tilt_rad in ((0.12, 0.1), (0.24, -0.2), (0.5, 0.3)):
        areas = np.array(coverage)
        full = multirotor_factors(
            0.12, z_m, areas, POSITIONS, 2.0, weight, b_rule, tilt_rad, rule == "vertical"
        )
        expected = partial_factor(full, areas)
        actual = factors(quad(rule, body_distance=b_rule), over(z_m, tilt_rad, coverage))
        np.testing.assert_allclose(actual, expected, rtol=1e-13)


@pytest.mark.parametrize("rule", TILT_RULES)
@pytest.mark.parametrize("free", [("plate_offset.dz_m",), ("plate_tilt.angle_rad",)])
def test_a_precomputed_model_equals_the_model_under_tilt(rule, free):
    model = quad(rule).with_effect("plate_offset", dz_m=0.004)
    model = model.with_effect("plate_tilt", angle_rad=0.02).with_free(*free)
    m = 12
    speeds = np.where(np.arange(m) % 3 == 0, np.array([[1.0], [1.0], [0.0], [1.0]]), 1.0) * 550.0
    conditions = Conditions.build(
        RIG,
        speed_rad_s=speeds,
        plate_z_m=np.linspace(0.15, 0.6, m),
        plate_x_m=np.linspace(-0.3, 0.3, m),
        plate_tilt_rad=np.linspace(-0.1, 0.1, m),
    )
    precomputed, values = PrecomputedModel(model, conditions), model.parameters.values_array()
    for step in (0.0, 0.01, -0.013):
        values[list(model.parameters).index(free[0])] += step
        np.testing.assert_allclose(
            precomputed.thrust_N(values), model.thrust_N(conditions, values), rtol=1e-12
        )


def test_a_rotor_at_rest_has_no_thrust_over_a_plate_of_free_height():
    model = Model.single(load_rig_by_name("pquad_single")).with_effect("plate_offset")
    stopped = Conditions.build(
        model.rig, speed_rad_s=np.zeros((1, 2)), plate_z_m=np.array([0.1, 0.2])
    )
    precomputed = PrecomputedModel(model.with_free("plate_offset.dz_m"), stopped, merge=False)
    assert not precomputed.thrust_N(model.parameters.values_array()).any()


def test_all_laws_of_distance_apply_along_the_rotor_axis():
    """For one rotor the denominator's term is the law's own, times the cosine."""
    bare = Model.single(load_rig_by_name("pquad_single")).without(OWN_IMAGES)
    for name, effect in EFFECTS.items():
        if effect.distance_law is None or effect.distance_law.surface != "below":
            continue
        model = bare.with_effect(effect)
        terms = [
            1.0 - 1.0 / ground_effect_ratio(
                model, "equal_rpm2", Conditions.build(
                    model.rig,
                    speed_rad_s=np.array([550.0]),
                    plate_z_m=np.array([0.15 / np.cos(tilt_rad)]),
                    plate_tilt_rad=tilt_rad,
                    coverage=np.ones((1, 1)),
                )
            )[0]
            for tilt_rad in (0.0, 0.2)
        ]  # fmt: skip
        assert terms[1] == pytest.approx(np.cos(0.2) * terms[0], rel=1e-12, abs=1e-15), name


def test_a_model_file_names_the_rule():
    loaded = load_model("quad_body_lift")
    assert loaded.model.tilt_rule == "axis"
    text = model_to_toml(replace(loaded, model=quad("vertical")))
    assert model_from_toml(text, "again.toml").model.tilt_rule == "vertical"
    with pytest.raises(UnknownChoice, match=r"unknown tilt rule 'own'.*own_height"):
        quad("own")
