"""`benchtool fit`: from run folders or any CSV to parameters with uncertainties and figures."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from benchtool.core.own_code import CodePermit
    from benchtool.fit.recipe import Recipe


def command(
    data: Annotated[
        list[str] | None,
        typer.Argument(help="Run folders or CSV files, or a recipe folder with --recipe."),
    ] = None,
    model: Annotated[
        str, typer.Option(help="Shipped model (benchtool models) or the path of a model file.")
    ] = "",
    recipe: Annotated[
        Path | None, typer.Option(help="Run the recipe.toml of this folder (as in fits/).")
    ] = None,
    rig: Annotated[
        str | None,
        typer.Option(help="Rig of a CSV: shipped name or path; a run folder carries its own."),
    ] = None,
    columns: Annotated[
        str | None, typer.Option(help="Mapping file: our channel = their column, unit, sign.")
    ] = None,
    where: Annotated[
        list[str] | None, typer.Option(help="Keep only rows with COLUMN=VALUE; repeatable.")
    ] = None,
    basis: Annotated[
        str, typer.Option(help="joint, or a ratio: equal_rpm2, equal_pwm, equal_power.")
    ] = "joint",
    method: Annotated[
        list[str] | None, typer.Option(help="least_squares (default), emcee; repeatable.")
    ] = None,
    free: Annotated[
        list[str] | None, typer.Option(help="Free one more parameter; repeatable.")
    ] = None,
    fix: Annotated[
        list[str] | None, typer.Option(help="Hold NAME=VALUE, or NAME at its value; repeatable.")
    ] = None,
    noise: Annotated[
        str, typer.Option(help="auto, stated, scale (one factor on the errors), add (scatter).")
    ] = "auto",
    loss: Annotated[str, typer.Option(help="linear, soft_l1 or huber.")] = "linear",
    compare: Annotated[
        list[str] | None, typer.Option(help="Hold this model against it, too; repeatable.")
    ] = None,
    profile: Annotated[
        bool, typer.Option("--profile", help="Profile-likelihood intervals as well.")
    ] = False,
    min_z_over_r: Annotated[
        float, typer.Option(help="Leave out points nearer than this z/R.", min=0.0)
    ] = 0.5,
    walkers: Annotated[int, typer.Option(help="Walkers of each emcee ensemble.")] = 32,
    max_steps: Annotated[int, typer.Option(help="Most emcee steps of each walker.")] = 20_000,
    seed: Annotated[int, typer.Option(help="Seed of everything random.", min=0)] = 1,
    out: Annotated[
        Path | None, typer.Option(help="Folder for result.json, figures and report.html.")
    ] = None,
) -> None:
    """Fit a ground-effect model to run folders or any CSV."""
    from benchtool.commands.terminal.announce_code import announce_code
    from benchtool.core.errors import InputError
    from benchtool.core.own_code import refuse_code
    from benchtool.fit.fit_options import held_by, recipe_of_options
    from benchtool.fit.recipe import read_recipe

    if recipe is not None:
        if data or model:
            raise InputError("--recipe says which data and model; leave DATA and --model out")
        asked, permit = read_recipe(recipe), refuse_code
    else:
        if not data:
            raise InputError(
                "nothing to fit: give run folders or CSV files, for example "
                "benchtool fit runs/NAME --model quad_body_lift"
            )
        if not model:
            from benchtool.physics.model_file import model_names

            raise InputError(f"which model? give --model with one of: {', '.join(model_names())}")
        held, numbers = held_by(fix or [])
        given = {
            "name": Path(data[0]).stem,
            "data": data,
            "model": model,
            "rig": rig,
            "columns": columns,
            "where": where or [],
            "basis": basis,
            "methods": method or ["least_squares"],
            "free": free or [],
            "fix": numbers,
            "hold": held,
            "noise": noise,
            "loss": loss,
            "compare": compare or [],
            "min_z_over_R": min_z_over_r,
            "walkers": walkers,
            "max_steps": max_steps,
            "seed": seed,
        }
        asked, permit = recipe_of_options(given), announce_code
    _run(asked, out, profile, permit)


def _run(recipe: Recipe, out: Path | None, profile: bool, permit: CodePermit) -> None:
    import sys

    from benchtool.commands.terminal.show_fit import print_fit, working
    from benchtool.fit.diagnose import refusal
    from benchtool.fit.run_recipe import run_recipe
    from benchtool.report.fit.page import refuse_full, write_fit

    if out is not None:
        refuse_full(out)
    with working() as tell:
        output = run_recipe(recipe, tell, profile=profile, permit=permit)
    print_fit(output)
    problem = refusal(output.results)
    if out is not None:
        page = write_fit(out, output, [shlex.join(["benchtool", *sys.argv[1:]])])
        model = "model.toml" if (out / "model.toml").is_file() else "no model (there is no answer)"
        print(f"written: {page} and, beside it, result.json, {model} and the figures")
    if problem is not None:
        raise problem
