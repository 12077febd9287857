"""The contract of every law of thrust against distance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from benchtool.core.errors import FileFormatError, InputError
from benchtool.core.rig import Rig
from benchtool.core.rig_file import load_rig_by_name
from benchtool.core.units import Array
from benchtool.physics.bases import ground_effect_ratio
from benchtool.physics.catalogue import EFFECTS
from benchtool.physics.conditions import Conditions
from benchtool.physics.distance_law import CONTACT_Z_OVER_R, DistanceLaw
from benchtool.physics.model import Model
from benchtool.physics.model_file import LoadedModel, model_from_toml, model_to_toml

LAWS = sorted(name for name, effect in EFFECTS.items() if effect.distance_law is not None)
EACH = pytest.mark.parametrize("name", LAWS)
RIG = load_rig_by_name("pquad_single")
NEAR_EQ_2 = ("exponential_law", "exponential_denominator", "inflow_exponential", "rational_law")


def stated(name: str) -> DistanceLaw:
    law = EFFECTS[name].distance_law
    assert law is not None
    return law


def acting(name: str, **values: float) -> Model:
    """Return one rotor under the law alone; a table with some made-up steps."""
    if name == "monotone_table" and not values:
        values = {f"step_{k}": 0.05 / k for k in range(1, 8)}
    if name == "wall" and not values:
        values = {"Ca": -0.1}
    return Model.single(rig_of(name)).with_law(name, **values)


def rig_of(name: str, rig: Rig = RIG) -> Rig:
    """Return a rig with its plate where the law has its surface."""
    return replace(rig, plate=replace(rig.plate, surface=stated(name).surface))


def ratio(model: Model, z_over_R: Array) -> Array:
    """Return T_IGE/T_OGE (m,) at these distances, as a sweep sees it."""
    z_m = np.asarray(z_over_R, float) * RIG.propulsion.radius_m
    near = Conditions.build(
        model.rig, speed_rad_s=np.array([500.0]), plate_z_m=z_m, coverage=np.ones((1, 1))
    )
    return np.asarray(ground_effect_ratio(model, "equal_rpm2", near))


def numbers(model: Model, name: str) -> dict[str, float]:
    values = model.effect_values(EFFECTS[name], [*model.parameters.values()])
    return {item.name: item.value for item in values}


FORMULAE: dict[str, Callable[[Array], Array]] = {
    "rotor_images": lambda x: 1.0 / (1.0 - 1.0 / (4.0 * x) ** 2),
    "cheeseman_bennett": lambda x: 1.0 / (1.0 - 1.0 / (4.0 * x) ** 2),
    "nobahari": lambda x: 1.0 / (1.0 - 6.25 / (4.0 * x) ** 2),
    "li": lambda x: 1.0 / (1.0 - 8.6 / (4.0 * x) ** 2),
    "hayden": lambda x: np.maximum(0.9926 + 0.03794 * (2.0 / x) ** 2, 1.0) ** (2.0 / 3.0),
    "exponential_law": lambda x: 1.0 + 1.7 * np.exp(-3.2 * x),
    "exponential_denominator": lambda x: 1.0 / (1.0 - 0.9 * np.exp(-2.6 * x)),
    "inflow_exponential": lambda x: (1.0 - 0.95 * np.exp(-2.1 * x)) ** (-2.0 / 3.0),
    "rational_law": lambda x: 1.0 + 0.1 / (x**2 + 0.05),
    "ceiling": lambda x: 1.0 / (1.0 - 0.1444 / (x + 0.315) ** 2),
    "ceiling_momentum": lambda x: 0.5 + 0.5 * np.sqrt(1.0 + 1.0 / (8.0 * x**2)),
    "wall": lambda x: 1.0 - 0.1 * np.exp(-x),
    "power_law": lambda x: 1.0 + 0.0625 * x**-2.0,
}  # fmt: skip


@pytest.mark.parametrize("name", sorted(FORMULAE))
def test_it_is_the_formula_that_its_source_prints(name):
    x = np.array([0.8, 1.0, 2.0, 3.0, 4.5, 6.0])
    np.testing.assert_allclose(ratio(acting(name), x), FORMULAE[name](x), rtol=1e-13)


def test_a_ceiling_by_momentum_theory_has_the_values_of_its_source():
    found = ratio(acting("ceiling_momentum"), np.array([0.25, 0.5]))
    np.testing.assert_allclose(found, [1.37, 1.11], atol=0.005)


def test_what_is_unverified_is_free():
    """Nobody takes a constant from memory for a known one."""
    for name in ("exponential_denominator", "rational_law", "ceiling", "wall"):
        assert all(item.free for item in EFFECTS[name].parameters)
        assert any(word in EFFECTS[name].description for word in ("free", "unverified"))


def test_a_rig_says_where_the_surface_is_and_refuses_laws_of_another():
    above = rig_of("ceiling")
    assert [effect.name for effect in Model.single(above).effects] == ["ceiling_momentum"]
    with pytest.raises(
        InputError, match=r"law hayden is for a surface below the rotors, but .* is above"
    ):
        Model.single(above).with_law("hayden")
    text = '[model]\nname = "mine"\nrig = "x"\n[effects.rotor_images]\nown_strength = 1.0\n'
    with pytest.raises(FileFormatError, match="allowed: ceiling, ceiling_momentum"):
        model_from_toml(text, "mine.toml", above)


def test_images_in_a_surface_below_do_not_act_under_a_ceiling():
    model = Model.single(rig_of("ceiling", load_rig_by_name("pquad")))
    at = Conditions.build(model.rig, speed_rad_s=np.full((4, 1), 500.0), plate_z_m=[0.06, 0.12])
    full = model.with_effect("neighbour_images").with_effect("body_lift")
    assert np.array_equal(
        ground_effect_ratio(full, "equal_rpm2", at), ground_effect_ratio(model, "equal_rpm2", at)
    )


def test_hayden_at_one_radius_and_where_it_is_clipped():
    found = ratio(acting("hayden"), np.array([1.0, 4.52, 4.53, 50.0]))
    assert found[0] == pytest.approx(1.094062, abs=5e-7)
    assert found[1] > 1.0
    assert found[2] == found[3] == 1.0
    assert "clipped" in stated("hayden").far


def test_defaults_without_a_source_pass_near_eq_2():
    x = np.array([0.5, 1.0])
    for name in NEAR_EQ_2:
        np.testing.assert_allclose(
            ratio(acting(name), x), ratio(acting("rotor_images"), x), atol=0.04
        )


@EACH
def test_it_states_what_is_known_of_it(name):
    law = stated(name)
    assert law.tested
    assert law.seen
    assert law.far.startswith("1")
    own = [item.name for item in EFFECTS[name].parameters]
    assert set(law.compared) <= set(own)
    assert law.same_as in ("", *LAWS)
    assert EFFECTS[name].benches == frozenset()  # an explanation names no law yet


@EACH
def test_far_away_it_is_one_and_nearer_it_never_falls(name):
    model = acting(name)
    reach = stated(name).nearest_z_over_R
    if singular := stated(name).singular:
        reach = max(reach, 1.01 * singular(numbers(model, name)))
    found = ratio(model, np.geomspace(reach, 1e4, 400))
    assert found[-1] == pytest.approx(1.0, abs=1e-6)
    toward_one = np.diff(found) * np.sign(found[0] - 1.0)
    assert np.all(toward_one <= 1e-14)
    assert abs(found[0] - 1.0) > 0.05


@EACH
def test_it_is_infinite_where_it_says_and_nowhere_else(name):
    law, model = stated(name), acting(name)
    if law.singular is None:
        at_contact = float(ratio(model, np.array([1e-9]))[0])
        assert 0.01 < abs(at_contact - 1.0) < 100.0
        assert model.nearest_z_over_R == CONTACT_Z_OVER_R < 0.01
        return
    assert model.nearest_z_over_R == 0.5
    pole = law.singular(numbers(model, name))
    near, nearer = ratio(model, np.array([pole + 1e-3, pole + 1e-4]))
    assert 3.0 < near < nearer
    assert nearer > 4.0 * near or pole > 0.0


@pytest.mark.parametrize("name", [name for name in LAWS if stated(name).surface == "below"])
def test_it_enters_the_sum_once_with_the_images_of_neighbours_and_the_body(name):
    """1/(1 - (1 - 1/G) - the rest), as eqs. (3) and (4) have it for eq. (2)."""
    rig = load_rig_by_name("pquad")
    z_m = np.array([1.2, 2.0, 4.0]) * rig.propulsion.radius_m
    at = Conditions.build(rig, speed_rad_s=np.full((4, 1), 500.0), plate_z_m=z_m)
    alone = 1.0 - 1.0 / ratio(acting(name), z_m / rig.propulsion.radius_m)
    bare = Model.single(rig).with_effect("neighbour_images").with_effect("body_lift")
    rest = 1.0 - 1.0 / ground_effect_ratio(bare.without("rotor_images"), "equal_rpm2", at)
    together = ground_effect_ratio(
        bare.with_law(name, **numbers(acting(name), name)), "equal_rpm2", at
    )
    np.testing.assert_allclose(together, 1.0 / (1.0 - alone - rest), rtol=1e-12)


@pytest.mark.parametrize(
    ("name", "values", "c"),
    [
        ("rotor_images", {"own_strength": 3.4}, 3.4),
        ("cheeseman_bennett", {"R_e_over_R": 1.3}, 1.69),
        ("nobahari", {}, 6.25),
    ],
)
def test_laws_that_are_one_by_another_parameter_say_so(name, values, c):
    x = np.array([0.7, 1.0, 3.0])
    model = acting(name, **values)
    np.testing.assert_allclose(ratio(model, x), ratio(acting("li", c=c), x), rtol=1e-13)
    assert (stated(name).same_as or name) == stated("li").same_as == "rotor_images"
    said = stated(name).singular
    assert said is not None
    assert said(numbers(model, name)) == pytest.approx(0.25 * c**0.5)


def test_a_table_takes_its_knots_from_the_model_file_and_gives_them_back():
    text = (
        '[model]\nname = "mine"\nrig = "pquad_single"\n[effects.monotone_table]\nstep_1 = 0.1\n'
        "step_3 = 0.2\n[effects.monotone_table.settings]\nz_over_R = [0.3, 1.0, 2.0]\n"
    )
    model = model_from_toml(text, "mine.toml").model
    found = ratio(model, np.array([1e-9, 0.3, 1.0, 2.0, 2.1]))
    np.testing.assert_allclose(found, [1.3, 1.3, 1.2, 1.0, 1.0], rtol=1e-13)
    again = model_from_toml(model_to_toml(LoadedModel(model=model)), "again.toml").model
    assert np.array_equal(
        ratio(again, np.geomspace(0.1, 3.0, 50)), ratio(model, np.geomspace(0.1, 3.0, 50))
    )
    with pytest.raises(InputError, match="two or more increasing values from 0"):
        model_from_toml(text.replace("[0.3, 1.0", "[1.3, 1.0"), "mine.toml")


def test_a_model_file_names_its_law_in_place_of_eq_2():
    text = '[model]\nname = "mine"\nrig = "pquad_single"\n[effects.hayden]\nstrength = 1.0\n'
    loaded = model_from_toml(text, "mine.toml")
    assert [effect.name for effect in loaded.model.effects] == ["hayden"]
    both = text + "[effects.rotor_images]\nown_strength = 1.0\n"
    with pytest.raises(FileFormatError, match="rotor_images and hayden; remove all but one"):
        model_from_toml(both, "mine.toml")
    left_out = model_from_toml(
        both.replace("own_strength = 1.0", "own_strength = 0.0"), "mine.toml"
    )
    assert left_out.model.nearest_z_over_R == 0.5
    assert [effect.name for effect in left_out.model.present_effects] == ["hayden"]
