"""A recipe of the page and the words that it shows to copy ask for the same fit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from benchtool.commands import fit
from benchtool.commands.app import main
from benchtool.commands.terminal.announce_code import announce_code
from benchtool.core.errors import InputError
from benchtool.core.inputs import changed, make, words
from benchtool.fit.recipe import FitInputs, Recipe

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
    asked = []
    monkeypatch.setattr(fit, "_run", lambda *given: asked.append(given))
    more = {"out": "fits/new", "profile": recipe.seed == 7}
    with pytest.raises(SystemExit):
        main(["fit", *words(FitInputs, changed(recipe) | more)])
    assert asked == [(recipe, Path("fits/new"), recipe.seed == 7, announce_code)]


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
    asked: list[Recipe] = []
    monkeypatch.setattr(fit, "_run", lambda recipe, *rest: asked.append(recipe))
    with pytest.raises(SystemExit):
        main(["fit", "--recipe", str(tmp_path), "--seed", "5", "--fix", "K_b=2", "--fix", "R_m"])
    (recipe,) = asked
    assert (recipe.seed, recipe.walkers, recipe.fix, recipe.hold) == (5, 40, {"K_b": 2.0}, ("R_m",))
