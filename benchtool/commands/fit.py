"""`benchtool fit`: from run folders or any CSV to parameters with uncertainties and figures."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchtool.commands.declared import declared
from benchtool.core.errors import InputError
from benchtool.fit.recipe import FitInputs, Recipe

if TYPE_CHECKING:
    from benchtool.core.own_code import CodePermit


def recipe_given(given: dict[str, Any], command: str) -> Recipe:
    """Return the recipe that options go over: that of a folder, or one of data and model."""
    from benchtool.fit.recipe import read_recipe

    if words := given.pop("fix", []):
        # A name without a value is held where the model has it.
        given["hold"] = [*given.get("hold", []), *(word for word in words if "=" not in word)]
        given["fix"] = [word for word in words if "=" in word]
    if (folder := given.get("recipe")) is not None:
        if "data" in given or "model" in given:
            raise InputError("--recipe says which data and model; leave DATA and --model out")
        return read_recipe(folder)
    if "data" not in given:
        raise InputError(
            f"nothing to {command}: give run folders or CSV files, for example "
            f"benchtool {command} runs/NAME --model quad_body_lift"
        )
    if "model" not in given:
        from benchtool.physics.model_file import model_names

        raise InputError(f"which model? give --model with one of: {', '.join(model_names())}")
    data = tuple(given["data"])
    return Recipe(name=Path(data[0]).stem, data=data, model=given["model"])


@declared(FitInputs, lambda given: FitInputs(recipe=recipe_given(given, "fit")))
def fit(inputs: FitInputs) -> None:
    """Fit a ground-effect model to run folders or any CSV."""
    from benchtool.commands.terminal.messages import announce_code
    from benchtool.core.own_code import refuse_code

    permit = announce_code if inputs.folder is None else refuse_code
    _run(inputs, permit)


def _run(inputs: FitInputs, permit: CodePermit) -> None:
    import sys

    from benchtool.commands.terminal.show_fit import print_fit, working
    from benchtool.fit.diagnose import refusal
    from benchtool.fit.run_recipe import run_recipe
    from benchtool.report.fit.page import refuse_full, write_fit

    if (out := inputs.out) is not None:
        refuse_full(out)
    with working() as report:
        output = run_recipe(
            inputs.recipe, report, profile=inputs.profile, budget=inputs.budget, permit=permit
        )
    print_fit(output)
    problem = refusal(output.results)
    if out is not None:
        page = write_fit(out, output, [shlex.join(["benchtool", *sys.argv[1:]])])
        model = "model.toml" if (out / "model.toml").is_file() else "no model (there is no answer)"
        print(f"written: {page} and, beside it, result.json, {model} and the figures")
    if problem is not None:
        raise problem
