"""Command `benchtool fit`: parameters with uncertainties from run folders or CSV files."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from benchtool.commands.input_commands import command_from_inputs
from benchtool.commands.recipe_options import TableInputs, recipe_from_options
from benchtool.commands.terminal.messages import announce_code
from benchtool.core.errors import InputError
from benchtool.core.inputs import Input, items
from benchtool.core.user_code import CodePermit, check_code_allowed
from benchtool.fit.recipe import FitInputs, Recipe
from benchtool.tasks import Cluster


@dataclass(frozen=True, slots=True, kw_only=True)
class FitArguments(FitInputs):
    """Command-line options of `benchtool fit`.

    Attributes:
        run_filters: row filters, one for each run of a table that is fitted separately.
    """

    table: TableInputs = field(default_factory=TableInputs)
    each: Annotated[
        bool,
        Input("Fit each DATA separately; --out contains one folder each.", group="Several runs"),
    ] = False
    cluster: Cluster = None
    run_filters: tuple[str, ...] = ()


def _base_inputs(options: dict[str, Any]) -> FitArguments:
    run_filters: tuple[str, ...] = ()
    if "data" in options and "recipe" not in options:
        from benchtool.commands.terminal.table_fit import prepare_table

        run_filters = prepare_table(options)
    inputs = FitArguments(recipe=recipe_from_options(options), run_filters=run_filters)
    for item in items(TableInputs):
        options.pop(item.name, None)  # already in the column map
    return inputs


@command_from_inputs(FitArguments, _base_inputs)
def fit(inputs: FitArguments) -> None:
    """Fit a ground-effect model to runs or CSV files."""
    import sys

    from benchtool.commands.terminal.show_fit import print_fit, progress_status
    from benchtool.fit.diagnose import find_error
    from benchtool.results import fit_result

    command = shlex.join(["benchtool", *sys.argv[1:]])
    if inputs.each or inputs.run_filters:
        _fit_each(inputs, command)
        return
    if inputs.cluster is not None:
        raise InputError("--cluster is for several fits; add --each, or remove it")
    with progress_status() as report:
        result = fit_result(inputs, report, _permit(inputs))
    print_fit(result.found)
    if inputs.out is not None:
        (page,) = result.save(inputs.out, [command])
        has_model = (inputs.out / "model.toml").is_file()
        model = "model.toml" if has_model else "no model (the fit failed)"
        print(f"written: {page}, result.json, {model} and figures in the same folder")
    if problem := find_error(result.found.results):
        raise problem


def _permit(inputs: FitInputs) -> CodePermit:
    return announce_code if inputs.folder is None else check_code_allowed


def _fit_each(inputs: FitArguments, command: str) -> None:
    """Fit several runs separately; print and write the fits."""
    from benchtool.commands.terminal.batch import index_by_name, outcome, raise_first, run_each
    from benchtool.commands.terminal.show_fit import print_fit, print_runs
    from benchtool.fit.diagnose import find_error
    from benchtool.fit.fit_data import recipe_model
    from benchtool.fit.result_file import parse_fit

    recipe = inputs.recipe
    if inputs.run_filters:
        recipes = {
            Path(value).name: replace(recipe, name=value, where=(*recipe.where, row_filter))
            for row_filter in inputs.run_filters
            for value in [row_filter.partition("=")[2]]
        }
    else:
        recipes = {
            name: replace(recipe, name=name, data=(data,))
            for name, data in index_by_name(recipe.data).items()
        }
    user_code = recipe_model(next(iter(recipes.values())), _permit(inputs)).effects_file
    if user_code and inputs.cluster is not None:
        raise InputError(
            f"the model has user code, {user_code}, which does not run on a cluster; remove "
            f"--cluster"
        )
    fit_inputs = FitInputs(
        folder=inputs.folder, recipe=recipe, profile=inputs.profile, budget=inputs.budget
    )
    outcomes = run_each(
        partial(outcome, partial(_fit_one, fit_inputs, inputs.out, (command,))),
        recipes,
        out=inputs.out,
        about={"fit": str(fit_inputs)},
        cluster=inputs.cluster,
        processes=0 if inputs.run_filters else None,
    )
    fits = {name: parse_fit(row["result"], name) for name, row in outcomes.items() if row["result"]}
    for name, summary in fits.items() if inputs.run_filters else ():
        print(f"\n{name}")
        print_fit(summary)
    if fits:
        print_runs(fits)
    if inputs.out is not None:
        folders = [str(inputs.out / name) for name in fits]
        print(f"written: {inputs.out}, with one folder each")
        if len(folders) > 1 and not inputs.run_filters:
            print(f"compare the rigs with: {shlex.join(['benchtool', 'pool', *folders])}")
    raise_first(outcomes)
    for problem in filter(None, (find_error(summary.results) for summary in fits.values())):
        raise problem


def _fit_one(
    inputs: FitInputs, out: Path | None, commands: Sequence[str], recipe: Recipe
) -> dict[str, Any]:
    """Write the folder of one fit and return the data of result.json; runs in a worker process.

    User code of the model has been announced by the caller.
    """
    from benchtool.commands.terminal.batch import write_folder_once
    from benchtool.fit.result_file import result_tables
    from benchtool.results import fit_result

    permit: CodePermit = (lambda file: None) if inputs.folder is None else check_code_allowed
    result = fit_result(replace(inputs, recipe=recipe), permit=permit)
    folder = None if out is None else out / Path(recipe.name).name
    write_folder_once(folder, lambda part: result.save(part, commands))
    return result_tables(result.found)
