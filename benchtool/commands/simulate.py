"""Commands `benchtool simulate pitch` and `benchtool simulate flight`: closed-loop simulations."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchtool import __version__
from benchtool.commands.input_commands import command_from_inputs
from benchtool.commands.terminal.messages import announce_code
from benchtool.core.errors import InputError, UnknownChoice, WouldOverwrite
from benchtool.core.text import format_arguments, pluralize
from benchtool.core.user_file import read_library_file
from benchtool.simulate.inputs import FlightInputs, PitchInputs

if TYPE_CHECKING:
    from benchtool.report.result import Result


@command_from_inputs(PitchInputs)
def pitch(inputs: PitchInputs) -> None:
    """Simulate a pitch bench with each controller.

    Writes recordings and a figure, or with --vary a table of many runs.
    """
    _begin(inputs.model)
    if inputs.study.campaign.vary:
        from benchtool.simulate.controllers.laws import PITCH_CONTROLLERS

        _run_campaign(inputs, PITCH_CONTROLLERS)
        return
    from benchtool.results import pitch_result

    with _compile_bar():
        result = pitch_result(inputs, permit=announce_code)
    _print_study(result, inputs.study.out)


@command_from_inputs(FlightInputs)
def flight(inputs: FlightInputs) -> None:
    """Simulate flights over an obstacle with each controller.

    Writes recordings and a figure, or with --vary a table of many flights.
    """
    _begin(inputs.model)
    if inputs.study.campaign.vary:
        from benchtool.simulate.controllers.laws import FLIGHT_CONTROLLERS
        from benchtool.simulate.flight.setup import OGE, full_name

        _run_campaign(inputs, (*FLIGHT_CONTROLLERS, OGE), full_name=full_name)
        return
    from benchtool.results import flight_result

    with _compile_bar():
        result = flight_result(inputs, permit=announce_code)
    _print_study(result, inputs.study.out)


def _begin(model: str) -> None:
    """Check the model name before slow imports; warn if simulations run without a compiler."""
    if model:
        read_library_file("model", "models", model)
    from benchtool.physics.expression import can_compile

    if not can_compile():
        print(
            "numba is not installed, so the simulation takes minutes instead of a second; use "
            "pip install benchtool[fast]",
            file=sys.stderr,
        )


@contextmanager
def _compile_bar() -> Iterator[None]:
    """Show a bar on a terminal while loops are compiled, once per installation."""
    from benchtool.physics.expression import watch_compilation

    with ExitStack() as stack:

        @cache
        def update() -> Callable[..., None]:
            from benchtool.commands.terminal.tables import progress_bar

            bar = stack.enter_context(progress_bar())
            return partial(bar.update, bar.add_task("compiling, once per installation", total=1.0))

        stack.enter_context(watch_compilation(lambda share: update()(completed=share)))
        yield


def _print_study(result: Result[Any], out: Path | None) -> None:
    """Print the summary of a result, and write it if a folder is given."""
    print(result.summary(), flush=True)
    if out is None:
        print("add --out FOLDER for the recordings (CSV) and the figure")
        return
    try:
        written = result.save(out)
    except OSError as error:
        raise InputError(
            f"{out} cannot be written: {error.strerror or error}; use another folder with --out"
        ) from error
    for path in written:
        if path.suffix != ".json":  # metadata of a recording
            print(f"written: {path}")


def _run_campaign(
    inputs: PitchInputs | FlightInputs, controllers: Iterable[str], **options: Any
) -> None:
    """Run a campaign, write its table, and print the mean of a measure.

    Args:
        controllers: available for campaigns.
        options: of `Design.read`.
    """
    from itertools import product
    from math import nan
    from time import monotonic

    from rich.progress import MofNCompleteColumn, TimeRemainingColumn

    from benchtool.commands.terminal.tables import progress_bar
    from benchtool.data.parquet import campaign_means
    from benchtool.physics.expression import watch_compilation
    from benchtool.simulate.campaign import Design, build_campaign, run_campaign

    _check_names(inputs, controllers)
    campaign = build_campaign(inputs, announce_code)
    study, campaign_inputs, out = inputs.study, inputs.study.campaign, inputs.study.out
    design = Design.read(
        campaign_inputs.vary,
        samples=campaign_inputs.samples,
        seeds=campaign_inputs.seeds,
        seed=study.seed,
        **options,
    )
    setup = campaign.first
    measure = campaign_inputs.measure or next(iter(setup.measures))
    if measure not in setup.measures:
        raise UnknownChoice("measure", measure, setup.measures)
    if out is None:
        raise InputError("a campaign needs a folder for its results; add --out FOLDER")
    table = out / "campaign.parquet"
    for path in (out, table):
        if path.exists() and not path.is_dir():
            raise WouldOverwrite(str(path))
    campaign.check(design)
    series = list(product(campaign.setups, campaign.controllers))
    total = design.n_points * design.seeds * len(series)
    print(
        f"SIMULATED campaign: {setup.campaign_title}; {design.describe()}; "
        f"{pluralize(total, 'run')}",
        flush=True,
    )
    metadata = {
        "simulated": "true", "benchtool": __version__, **setup.to_metadata(),
        **design.to_metadata(),
        "set": " ".join(format_arguments(study.settings, commas=False)),
    }  # fmt: skip
    start_s = monotonic()
    with progress_bar(MofNCompleteColumn(), TimeRemainingColumn(), transient=False) as progress:
        task = progress.add_task("runs", total=total)

        def show_compiled(share: float) -> None:
            progress.update(task, description=f"runs, compiling once ({share:.0%})")

        try:
            with watch_compilation(show_compiled):
                count = run_campaign(
                    campaign, inputs, design, table, metadata,
                    lambda done: progress.update(task, completed=done, description="runs"),
                )  # fmt: skip
        except KeyboardInterrupt:
            rows = table.with_name("runs.jsonl")
            print(f"stopped; results are in {rows}; the same command resumes", file=sys.stderr)
            raise
    duration_s = max(monotonic() - start_s, 1e-9)
    print(f"{pluralize(count, 'run')} in {duration_s:.1f} s, {count / duration_s:.3g} runs/s")
    print(f"written: {table}", flush=True)
    means = campaign_means(table, measure)
    if not means:
        raise InputError(f"{measure} has no value in any run; use another with --measure")
    print(f"{setup.measures[measure]}, mean of all runs:")
    for gains, controller in series:
        name = f"{gains}, {controller}" if len(campaign.setups) > 1 else controller
        print(f"  {name}: {means.get((gains, controller), nan):.3g}")


def _check_names(inputs: PitchInputs | FlightInputs, controllers: Iterable[str]) -> None:
    """Raise for user controllers, unknown controllers, and duplicate names."""
    for option, names in (("--controllers", inputs.controllers), ("--gains", inputs.study.gains)):
        if len(set(names)) < len(names):
            raise InputError(f"{option} is {', '.join(names)}; name each once")
    for name in inputs.controllers:
        if ":" in name:
            raise InputError("campaigns run built-in controllers only; remove user controllers")
        if name not in controllers:
            raise UnknownChoice("controller", name, controllers)
