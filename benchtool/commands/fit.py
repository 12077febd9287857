"""`benchtool fit`: from run folders or any CSV to parameters with uncertainties and figures."""

from __future__ import annotations

import shlex
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchtool.commands.declared import declared
from benchtool.commands.recipe_options import TableInputs, recipe_given
from benchtool.commands.terminal.messages import announce_code
from benchtool.core.inputs import items
from benchtool.core.own_code import refuse_code
from benchtool.fit.recipe import FitInputs

if TYPE_CHECKING:
    from benchtool.fit.run_recipe import FitOutput


@dataclass(frozen=True, slots=True, kw_only=True)
class FitWords(FitInputs):
    """What `benchtool fit` takes on the command line.

    Attributes:
        one_by_one: filters of the runs in a table that are fitted each by itself.
    """

    table: TableInputs = field(default_factory=TableInputs)
    one_by_one: tuple[str, ...] = ()


def _completed(given: dict[str, Any]) -> FitWords:
    one_by_one: tuple[str, ...] = ()
    if "data" in given and "recipe" not in given:
        from benchtool.commands.terminal.table_fit import prepare_table

        one_by_one = prepare_table(given)
    words = FitWords(recipe=recipe_given(given, "fit"), one_by_one=one_by_one)
    for item in items(TableInputs):
        given.pop(item.name, None)  # they are in the map now
    return words


@declared(FitWords, _completed)
def fit(inputs: FitWords) -> None:
    """Fit a ground-effect model to run folders or any CSV."""
    from benchtool.commands.terminal.show_fit import print_runs
    from benchtool.fit.diagnose import refusal
    from benchtool.report.fit.page import refuse_full

    if inputs.out is not None:
        refuse_full(inputs.out)
    if not inputs.one_by_one:
        problems = [refusal(_fitted(inputs).results)]
    else:
        outputs: dict[str, FitOutput] = {}
        for only in inputs.one_by_one:
            name = only.partition("=")[2]
            print(f"\n{only}")
            recipe = replace(inputs.recipe, name=name, where=(*inputs.recipe.where, only))
            out = None if inputs.out is None else inputs.out / Path(name).name
            outputs[name] = _fitted(replace(inputs, recipe=recipe, out=out))
        print_runs(outputs)
        problems = [refusal(one.results) for one in outputs.values()]
    for problem in filter(None, problems):
        raise problem


def _fitted(inputs: FitWords) -> FitOutput:
    """Return one fit, printed and written."""
    import sys

    from benchtool.commands.terminal.show_fit import print_fit, working
    from benchtool.results import fit_result

    permit = announce_code if inputs.folder is None else refuse_code
    with working() as report:
        result = fit_result(inputs, report, permit)
    print_fit(result.found)
    if inputs.out is not None:
        (page,) = result.save(inputs.out, [shlex.join(["benchtool", *sys.argv[1:]])])
        has_model = (inputs.out / "model.toml").is_file()
        model = "model.toml" if has_model else "no model (there is no answer)"
        print(f"written: {page} and, beside it, result.json, {model} and the figures")
    return result.found
