"""A parameter is named by its full name or by its last part, and what is named is heeded."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import pytest

from benchtool import results
from benchtool.commands.app import main
from benchtool.commands.terminal.messages import announce_code
from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.inputs import changed, make, words
from benchtool.core.parameter import full_name
from benchtool.fit.fit_data import recipe_model
from benchtool.fit.recipe import FitInputs, Recipe

QUAD = str(Path(__file__).parents[3] / "datasets" / "quad" / "run")


def quad(**more: object) -> Recipe:
    return Recipe(name="quad", data=(QUAD,), model="quad_bench", **more)  # type: ignore[arg-type]


def test_a_last_part_serves_where_it_is_unique() -> None:
    items = recipe_model(
        quad(fix={"K_b": 2.0}, hold=("dz_m",), free=("strength",))
    ).model.parameters
    assert (items["body_lift.K_b"].value, items["body_lift.K_b"].free) == (2.0, False)
    assert not items["plate_offset.dz_m"].free
    assert items["neighbour_images.strength"].free


def test_a_last_part_of_several_names_is_refused_with_them() -> None:
    known = ["tare_offset.thrust_N", "other.thrust_N", "k"]
    assert full_name("k", known) == "k"
    with pytest.raises(UnknownChoice, match=r"known: other\.thrust_N, tare_offset\.thrust_N$"):
        full_name("thrust_N", known)
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
def test_a_parameter_is_not_named_twice(named: Mapping[str, object]) -> None:
    with pytest.raises(InputError, match=r"body_lift\.K_b is named twice"):
        recipe_model(quad(**named))


def test_noise_that_is_named_by_itself_is_heeded() -> None:
    held = results.run_recipe(quad(fix={"noise.scale": 2.0}))
    assert held.problem.noise_name is None
    assert held.problem.sigma() == pytest.approx(2.0 * held.problem.standard_error)
    freed = results.run_recipe(quad(noise="stated", free=("noise.scale",)))
    assert freed.problem.noise_name == "noise.scale"


def test_a_result_is_asked_by_last_parts_too() -> None:
    result = results.run_recipe(quad(noise="stated")).results[0]
    assert result["K_b"] is result["body_lift.K_b"]


PLAIN = Recipe(name="one", data=("runs/one",), model="quad_bench")
FULL = Recipe(
    name="one",
    data=("runs/one", "runs/two words"),
    model="fits/x/model.toml",
    columns="a/columns.toml",
    where=("series=Fz0", "a b=c"),
    basis="equal_pwm",
    methods=("least_squares", "emcee"),
    free=("k",),
    fix={"body_lift.K_b": 2.0, "R_m": 0.1 + 0.2, "plate_offset.dz_m": -1e-7},
    hold=("tare_offset.thrust_N",),
    noise="add",
    loss="huber",
    min_z_over_R=0.0,
    compare=("single", "quad"),
    walkers=48,
    max_steps=500,
    seed=7,
)


@pytest.mark.parametrize("recipe", [PLAIN, FULL, replace(PLAIN, methods=("emcee",), columns="m")])
def test_the_words_ask_for_the_same_recipe(recipe: Recipe, monkeypatch: pytest.MonkeyPatch) -> None:
    asked, outs = captured(monkeypatch), []
    monkeypatch.setattr(results, "refuse_full", outs.append)
    more = {"out": "fits/new", "profile": recipe.seed == 7}
    with pytest.raises(SystemExit):
        main(["fit", *words(FitInputs, changed(recipe) | more)])
    ((given, options),) = asked
    assert given == recipe
    assert (options["profile"], options["permit"]) == (recipe.seed == 7, announce_code)
    assert outs == [Path("fits/new")]


def captured(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Recipe, dict[str, Any]]]:
    """Return a list that the recipe of a fit goes to, which is then not run."""
    asked: list[tuple[Recipe, dict[str, Any]]] = []

    def run(recipe: Recipe, report: object, **options: Any) -> NoReturn:
        asked.append((recipe, options))
        raise SystemExit(0)

    monkeypatch.setattr(results, "run_recipe", run)
    return asked


def test_what_is_usual_is_left_out() -> None:
    assert words(FitInputs, changed(PLAIN)) == ["runs/one", "--model", "quad_bench"]


def test_a_value_that_no_option_takes_is_refused_in_its_words() -> None:
    with pytest.raises(InputError, match=r"^--min-z-over-r is -1, allowed is 0 or more"):
        make(Recipe, {"min_z_over_r": -1.0}, source="option", base=PLAIN)
    with pytest.raises(InputError, match=r"^--method names nothing"):
        make(Recipe, {"method": []}, source="option", base=PLAIN)


def test_options_go_over_a_recipe_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "recipe.toml").write_text(
        "[recipe]\nname = 'a'\ndata = ['r']\nmodel = 'quad'\nseed = 4\nwalkers = 40\n", "utf-8"
    )
    asked = captured(monkeypatch)
    with pytest.raises(SystemExit):
        main(["fit", "--recipe", str(tmp_path), "--seed", "5", "--fix", "K_b=2", "--fix", "R_m"])
    ((recipe, _),) = asked
    assert (recipe.seed, recipe.walkers, recipe.fix, recipe.hold) == (5, 40, {"K_b": 2.0}, ("R_m",))
