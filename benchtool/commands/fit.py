"""Commands `benchtool fit` and `benchtool pool`: parameters of one model, or of several rigs."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from annotated_types import Ge

from benchtool.commands.input_commands import Verbose, command_from_inputs
from benchtool.commands.terminal.messages import announce_code, typed_command
from benchtool.core.errors import InputError, ModelRejected
from benchtool.core.inputs import Input, Inputs, build_inputs, items
from benchtool.core.user_code import CodePermit, check_code_allowed
from benchtool.core.user_file import read_library_file
from benchtool.data.atomic import data_hash
from benchtool.fit.recipe import FitInputs, Recipe, TableFitInputs, TableInputs, base_recipe
from benchtool.tasks import Cluster

if TYPE_CHECKING:
    from benchtool.fit.run_recipe import FitSummary

MAX_COLUMNS = 5  # of a table on a terminal


@dataclass(frozen=True, slots=True, kw_only=True)
class FitArguments(TableFitInputs):
    """Command-line options of `benchtool fit`.

    Attributes:
        run_filters: row filters, one for each run of a table that is fitted separately.
    """

    each: Annotated[
        bool,
        Input("Fit each DATA separately; --out contains one folder each.", group="Several runs"),
    ] = False
    cluster: Cluster = None
    verbose: Verbose = False
    run_filters: tuple[str, ...] = ()


def _base_inputs(options: dict[str, Any]) -> FitArguments:
    run_filters: tuple[str, ...] = ()
    given = {item.name: options[item.name] for item in items(TableInputs) if item.name in options}
    if "data" in options and "recipe" not in options:
        # Wrong values and names are reported before numpy is imported.
        for item in items(FitArguments):
            if item.name in options and item.name != "fix":  # may be a name without a value
                item.read(options[item.name], item.option)
        for path in options["data"]:
            if not Path(path).exists():
                data_hash(path)  # raises the error
        for kind in ("model", "rig"):
            if kind in options:
                read_library_file(kind, f"{kind}s", options[kind])
        from benchtool.table_fit import prepare_table

        table = build_inputs(TableInputs, given, source="option")
        run_filters = prepare_table(
            options, table, print, lambda line: print(f"note: {line}"), command=typed_command()
        )
    inputs = FitArguments(recipe=base_recipe(options), run_filters=run_filters)
    for name in given:
        del options[name]  # already in the column map
    return inputs


@command_from_inputs(FitArguments, _base_inputs)
def fit(inputs: FitArguments) -> None:
    """Fit a ground-effect model to runs or CSV files."""
    from benchtool.data.run.read import find_parts
    from benchtool.fit.nominal import rig_for_data

    # A wrong rig is reported before the imports of a fit, which take longer than all of this.
    recipe = inputs.recipe
    parts = [part for path in recipe.data for part in find_parts(path)]
    rig_for_data(parts, recipe.model, recipe.rig)

    from rich.progress import TextColumn, TimeRemainingColumn

    from benchtool.commands.terminal.tables import progress_bar
    from benchtool.fit.diagnose import find_error
    from benchtool.results import fit_result

    if inputs.each or inputs.run_filters:
        _fit_each(inputs)
        return
    if inputs.cluster is not None:
        raise InputError("--cluster is for several fits; add --each, or remove it")
    counts = TextColumn("{task.completed:.0f}/{task.total:.0f}")
    with progress_bar(counts, TimeRemainingColumn()) as bar:
        task = bar.add_task("reading", total=1)

        def report(stage: str, done: int, expected: int) -> None:
            bar.update(task, description=stage, completed=done, total=max(expected, 1))

        result = fit_result(inputs, report, _permit(inputs))
    _print_fit(result.found, verbose=inputs.verbose)
    if inputs.out is not None:
        page, *_ = result.save(inputs.out, [typed_command()])
        has_model = (inputs.out / "model.toml").is_file()
        model = "model.toml" if has_model else "no model (the fit failed)"
        print(f"written: {page}, result.json, {model} and figures in the same folder")
    if problem := find_error(result.found.results):
        if isinstance(problem, ModelRejected):
            command = ["benchtool", "explain", *recipe.data, "--model", recipe.model]
            print(f"next: {shlex.join(command)} --check OTHER_RUN")
        raise problem
    if inputs.out is None:
        print(f"next: {typed_command()} --out FOLDER  # report, figures, model.toml")
    else:
        model = str(inputs.out / "model.toml")
        print(f"next: {shlex.join(['benchtool', 'export', model, '--to', 'all'])}")


def _permit(inputs: FitInputs) -> CodePermit:
    return announce_code if inputs.folder is None else check_code_allowed


def _fit_each(inputs: FitArguments) -> None:
    """Fit several runs separately; print and write the fits."""
    from benchtool.commands.terminal.batch import index_by_name, raise_first, run_each
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
        partial(_fit_one, fit_inputs, inputs.out, (typed_command(),)),
        recipes,
        out=inputs.out,
        about={"fit": str(fit_inputs)},
        cluster=inputs.cluster,
        processes=0 if inputs.run_filters else None,
    )
    fits = {name: parse_fit(row["result"], name) for name, row in outcomes.items() if row["result"]}
    for name, summary in fits.items() if inputs.run_filters and inputs.verbose else ():
        print(f"\n{name}")
        _print_fit(summary, verbose=True)
    if fits:
        _print_runs(fits)
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


def _print_fit(fit: FitSummary, *, verbose: bool) -> None:
    """Print the sections of a fit report, or a summary of one screen."""
    from benchtool.commands.terminal.tables import Output, print_table
    from benchtool.report.fit.page import summary_blocks, terminal_blocks
    from benchtool.report.page import Table, Warnings

    console = Output()
    for section in terminal_blocks(fit) if verbose else summary_blocks(fit):
        if isinstance(section, Table):
            width = max(MAX_COLUMNS, section.text_columns + 3)
            print_table(console, section.select_columns(range(min(width, len(section.header)))))
        elif isinstance(section, Warnings):
            console.print_lines(*(f"! {line}" for line in section.sentences))
        elif isinstance(section, str):
            console.print_lines(section)


def _print_runs(fits: Mapping[str, FitSummary]) -> None:
    """Print a table with one row per run."""
    from benchtool.commands.terminal.tables import Output, print_table
    from benchtool.report.fit.tables import value_cells, wanted_rank
    from benchtool.report.page import Table

    first = next(iter(fits.values())).results[0]
    names = [item.name for item in (*first.estimates, *first.derived)]
    names.sort(key=lambda name: (wanted_rank(name), name.startswith("noise.")))
    names = names[: MAX_COLUMNS - 2]
    rows = [
        (run, *value_cells(fit.results[0], names), f"{fit.results[0].chi2_per_dof:.3g}")
        for run, fit in fits.items()
    ]
    head = ("run", *names, "chi2/dof")
    print_table(Output(), Table("Separate fits: value ± standard uncertainty.", head, rows))


@dataclass(frozen=True, slots=True, kw_only=True)
class PoolInputs(Inputs):
    """Options of `benchtool pool`."""

    fits: Annotated[
        tuple[Path, ...], Input("Fit folders (benchtool fit --out), one per rig.", argument="FIT")
    ] = ()
    of: Annotated[
        tuple[str, ...],
        Input(
            "Parameter that may differ between rigs; repeatable.", default_text="all without a unit"
        ),
    ] = ()
    shared: Annotated[tuple[str, ...], Input("Parameter equal in all rigs; repeatable.")] = ()
    seed: Annotated[int, Ge(0), Input("Random seed.")] = 1
    out: Annotated[Path | None, Input("New folder for report, figure and pool.json.")] = None


@command_from_inputs(PoolInputs)
def pool(inputs: PoolInputs) -> None:
    """Combine fits of several rigs in a hierarchical model."""
    from benchtool.data.run.entry import name_fits

    name_fits(inputs.fits)  # raises before the imports of a pooled fit
    from benchtool.commands.terminal.tables import Output, print_table
    from benchtool.report.compare.pooled import rigs_table
    from benchtool.report.fit.page import refuse_full
    from benchtool.results import pool_result

    if inputs.out is not None:
        refuse_full(inputs.out)
    result = pool_result(inputs.fits, inputs.of, inputs.shared, inputs.seed)
    print_table(Output(), rigs_table(result.found))
    print(result.summary())
    if inputs.out is not None:
        for path in result.save(inputs.out, [typed_command()]):
            print(f"written: {path}")
