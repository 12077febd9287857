"""`benchtool plan`: what reaches a target uncertainty, and the sweep to type next."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from benchtool.commands.declared import declared
from benchtool.commands.recipe_options import recipe_given
from benchtool.commands.terminal.messages import announce_code
from benchtool.core.errors import InputError
from benchtool.core.inputs import Input, Inputs
from benchtool.core.own_code import refuse_code
from benchtool.fit.recipe import Recipe

if TYPE_CHECKING:
    from benchtool.fit.run_recipe import FitOutput
    from benchtool.fit.uncertainty.reach import Reach, Way


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanInputs(Inputs):
    """What `benchtool plan` takes."""

    goal: Annotated[
        str,
        Input(
            "Quantity and target standard uncertainty: R=0.5%, or K_b=0.02 in its unit.",
            option="for",
        ),
    ] = ""
    folder: Annotated[
        Path | None, Input("Take the recipe.toml of this folder (as in fits/).", option="recipe")
    ] = None
    recipe: Recipe


@declared(PlanInputs, lambda given: PlanInputs(recipe=recipe_given(given, "plan")))
def plan(inputs: PlanInputs) -> None:
    """Find visits and better inputs for a target uncertainty."""
    from benchtool.commands.terminal.show_fit import working
    from benchtool.commands.terminal.tables import Output, print_table
    from benchtool.fit.run_recipe import run_recipe
    from benchtool.fit.uncertainty.reach import quantity_named, reach
    from benchtool.report.page import Table

    name, wanted, relative = _goal(inputs.goal)
    with working() as report:
        permit = announce_code if inputs.folder is None else refuse_code
        output = run_recipe(inputs.recipe, report, permit=permit)
    names = output.budget.names if output.budget else ()
    found = reach(output, quantity_named(name, names), wanted, relative=relative)
    console = Output()
    console.say(
        f"{found.name}: standard uncertainty {_size(found, found.sd)} now, "
        f"target {_size(found, found.wanted)}"
    )
    if found.sd <= found.wanted:
        console.say("the target is reached: no further measurement is needed")
        return
    rows = [
        (_words(one, output), _size(found, one.sd), _judged(one.sd, found)) for one in found.single
    ]
    heads = ("single step", "resulting uncertainty", "sufficient")
    print_table(console, Table("Predicted from the sensitivities of this fit:", heads, rows))
    if any(one.sd > found.sd for one in found.single):
        console.say(
            "Where a step increases it, the fit leans more on what it holds fixed "
            "(* in the budget of benchtool fit); determine that first."
        )
    reached = "reaches" if found.reached else "comes closest with"
    console.say(
        f"combined: {_words(found.together, output) or 'nothing'} {reached} "
        f"{_size(found, found.together.sd)}"
    )
    if found.together.visits > 1 or found.together.moved:
        console.say("next:", f"  {_command(found.together, output)}")


def _goal(text: str) -> tuple[str, float, bool]:
    """Return quantity, number, and whether it is relative to the value."""
    if not text:
        raise InputError("no target uncertainty is given; give one, for example --for R=0.5%")
    match = re.fullmatch(r"\s*([\w.]+)\s*=\s*([0-9.]+(?:[eE][-+]?[0-9]+)?)\s*(%?)\s*", text)
    try:
        name, number, percent = match.groups() if match else ("", "", "")
        wanted = float(number) * (0.01 if percent else 1.0)
    except ValueError:
        wanted = 0.0
    if not wanted > 0.0:
        raise InputError(
            f"--for is {text!r}, but a quantity and a number above 0 are needed, such as R=0.5% or "
            f"K_b=0.02"
        )
    return name, wanted, bool(percent)


def _size(found: Reach, sd: float) -> str:
    """Return an uncertainty in percent of the value and in its unit."""
    unit = "" if found.unit == "1" else f" {found.unit}"
    share = f"{100.0 * sd / abs(found.value):.2g} % (" if found.value else "("
    return f"{share}{sd:.2g}{unit})"


def _judged(sd: float, found: Reach) -> str:
    return "yes" if sd <= found.wanted else "no" if sd < found.sd else "no: it increases"


def _words(way: Way, output: FitOutput) -> str:
    """Say what to do, in the words of a bench."""
    words = []
    if way.visits > 1:
        words.append(f"visit every setting {way.visits} times as often")
    if way.moved:
        words.append(f"visit z/R {way.moved[1]:g} in place of {way.moved[0]:g}")
    assert output.budget is not None  # what was reached came from it
    for line in output.budget.lines:
        if line.name in way.known:
            unit = "" if line.unit == "1" else f" {line.unit}"
            sd = way.known[line.name] * line.sd
            words.append(f"determine {line.name} to {sd:.2g}{unit} (now {line.sd:.2g}{unit})")
    return ", ".join(words)


def _command(way: Way, output: FitOutput) -> str:
    """Return the sweep that does it, as it is typed: on the run's bench, else a dry run."""
    from benchtool.acquire.plan import read_plan
    from benchtool.data.run.facts import read_metadata
    from benchtool.data.run.read import is_run

    rig, data = output.fitted.rig, output.data
    ratios = sorted({float(z) for z in data.z_over_R[data.used].round(2) if z < 9.0})
    repeats = 1
    path = Path(output.recipe.data[0])
    if is_run(path):
        before = read_plan(path / "plan.toml")
        repeats = before.repeats or 1
        ratios = [z_m / rig.propulsion.radius_m for z_m in before.plate.distances_m] or ratios
        address = str(read_metadata(path)["address"])
        words = ["sweep", address, "--plan", str(path / "plan.toml"), "--out", f"{path}-next"]
        words += ["--yes"] if address.startswith("sim:") else []
    else:
        words = ["sweep", f"sim:{output.recipe.rig or rig.name}", "--dry-run"]
    if way.moved:
        ratios = [way.moved[1] if abs(z - way.moved[0]) < 0.01 else z for z in ratios]
    if way.moved or not is_run(path):
        words += ["--z-over-r", ",".join(f"{z:.4g}" for z in sorted(ratios))]
    return shlex.join(["benchtool", *words, "--repeats", str(repeats * way.visits)])
