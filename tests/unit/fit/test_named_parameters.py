"""A parameter is named by its full name or by its last part, and what is named is heeded."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.parameter import resolve_name
from benchtool.fit.fit_data import recipe_model
from benchtool.fit.recipe import Recipe
from benchtool.fit.run_recipe import run_recipe

QUAD = str(Path(__file__).parents[3] / "datasets" / "quad" / "run")


def quad(**more: object) -> Recipe:
    return Recipe(name="quad", data=(QUAD,), model="quad_bench", **more)  # type: ignore[arg-type]


def test_a_last_part_serves_where_it_is_unique():
    items = recipe_model(
        quad(fix={"K_b": 2.0}, hold=("dz_m",), free=("strength",))
    ).model.parameters
    assert (items["body_lift.K_b"].value, items["body_lift.K_b"].free) == (2.0, False)
    assert not items["plate_offset.dz_m"].free
    assert items["neighbour_images.strength"].free


def test_a_last_part_of_several_names_is_refused_with_them():
    known = ["tare_offset.thrust_N", "other.thrust_N", "k"]
    assert resolve_name("k", known) == "k"
    with pytest.raises(UnknownChoice, match=r"known: other\.thrust_N, tare_offset\.thrust_N$"):
        resolve_name("thrust_N", known)
    with pytest.raises(UnknownChoice, match=r"'K_c'; did you mean 'body_lift\.K_b'"):
        recipe_model(quad(free=("K_c",)))


@pytest.mark.parametrize(
    "named",
    [
        {"free": ("K_b",), "fix": {"body_lift.K_b": 2.0}},
        {"fix": {"K_b": 2.0, "body_lift.K_b": 3.0}},
        {"fix": {"K_b": 2.0}, "hold": ("body_lift.K_b",)},
    ],
)
def test_a_parameter_is_not_named_twice(named):
    with pytest.raises(InputError, match=r"duplicate parameter body_lift\.K_b"):
        recipe_model(quad(**named))


def test_noise_that_is_named_by_itself_is_heeded():
    held = run_recipe(quad(fix={"noise.scale": 2.0}))
    assert held.problem.noise_name is None
    assert held.problem.sigma() == pytest.approx(2.0 * held.problem.standard_error)
    freed = run_recipe(quad(noise="stated", free=("noise.scale",)))
    assert freed.problem.noise_name == "noise.scale"
