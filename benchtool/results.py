"""What fits, explanations and simulations find, as one kind of result.

The command line, the page and Python all come through here, so the three cannot differ.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import monotonic

from benchtool.core.user_code import CodePermit, check_code_allowed
from benchtool.data.columns import frame, frame_of_rows
from benchtool.explain.answer import ExplainResult, Request, answer_request, read_request
from benchtool.explain.engine.hypotheses import Bootstrap
from benchtool.explain.engine.judgement import Progress
from benchtool.explain.engine.verdict import SURE
from benchtool.explain.inputs import ExplainInputs
from benchtool.fit.recipe import FitInputs
from benchtool.fit.run_recipe import FitOutput, run_recipe
from benchtool.report.answer.folder import PAGE, write_folder
from benchtool.report.answer.page import ANSWER
from benchtool.report.compare import pooled as pooling
from benchtool.report.compare.pooled import PooledFits, pool_fits
from benchtool.report.fit.figures import ratio_rows
from benchtool.report.fit.page import FIT, refuse_full, sentence, write_fit
from benchtool.report.flight import flight as flight_report
from benchtool.report.flight import pitch_study as pitch_report
from benchtool.report.result import (
    Result,
    effects_frame,
    estimates_frame,
    gap_frame,
    probabilities_frame,
)
from benchtool.simulate.controllers.laws import FLIGHT_CONTROLLERS, PITCH_CONTROLLERS
from benchtool.simulate.flight.inputs import FlightInputs
from benchtool.simulate.flight.inputs import setup_of as flight_setup_of
from benchtool.simulate.flight.study import FlownCase, name_of, recording_of
from benchtool.simulate.pitch.inputs import PitchInputs
from benchtool.simulate.pitch.inputs import setup_of as pitch_setup_of
from benchtool.simulate.user_controller import Controllers, split_controllers


def fit_result(
    inputs: FitInputs,
    progress: Callable[[str, int, int], None] = lambda what, done, expected: None,
    permit: CodePermit = check_code_allowed,
) -> Result[FitOutput]:
    """Fit a recipe. Tables: `estimates`, `points` and `ratio`.

    Args:
        progress: called with what is being done, how much of it is done, and of how much.
        permit: called with a model's own Python before it is run.

    Raises:
        WouldOverwrite: the folder that it is to be written to holds something.
        InputError: the data or the model do not allow the fit.
        EstimationError: no estimate can be given.
    """
    if inputs.out is not None:
        refuse_full(inputs.out)
    output = run_recipe(
        inputs.recipe, progress, profile=inputs.profile, budget=inputs.budget, permit=permit
    )
    return Result(
        found=output,
        _page=FIT,
        _summary=sentence,
        _tables={
            "estimates": estimates_frame,
            "points": lambda one: frame(one.data.points),
            "ratio": lambda one: frame_of_rows(ratio_rows(one)),
        },
        _write=lambda folder, one, commands: [write_fit(folder, one, commands)],
    )


def pool_result(
    folders: Sequence[Path], of: Sequence[str] = (), shared: Sequence[str] = (), seed: int = 1
) -> Result[PooledFits]:
    """Pool fits of several rigs, as `pool_fits` takes them. Tables: `rigs` and `differences`."""
    return Result(
        found=pool_fits(folders, of, shared, seed=seed),
        _page=pooling.POOL,
        _summary=pooling.summary,
        _tables={
            "rigs": lambda one: frame_of_rows(pooling.rigs_rows(one)),
            "differences": lambda one: frame_of_rows(pooling.differences_rows(one)),
        },
        _write=pooling.write_pool,
    )


def build_request(inputs: ExplainInputs, permit: CodePermit = check_code_allowed) -> Request:
    """Read the recordings, the model and the effects that inputs name."""
    return read_request(
        inputs.recordings, inputs.check, inputs.model, inputs.effects, permit, inputs.rig
    )


def explain_result(
    inputs: ExplainInputs,
    progress: Progress = lambda what, share: None,
    permit: CodePermit = check_code_allowed,
    *,
    request: Request | None = None,
    minutes: float | None = None,
    commands: Sequence[str] = (),
) -> Result[ExplainResult]:
    """Name what a model lacks. Tables: `effects`, `gap` and `probabilities`.

    Args:
        progress: called with what is being done, and the share that is done.
        permit: called with each Python file before it is run.
        request: what the inputs name, where it is read already.
        minutes: that further experiments may take; None where nobody makes them.
        commands: that asked, for the answer's page.

    Raises:
        InputError: whatever is missing or cannot be read.
    """
    began = monotonic()
    request = build_request(inputs, permit) if request is None else request
    answer = answer_request(
        request,
        commands=commands,
        seed=inputs.seed,
        draws=inputs.draws,
        bootstrap=Bootstrap(draws=inputs.bootstrap, cluster=inputs.cluster),
        sure=SURE if inputs.bench is None else inputs.until,
        minutes=minutes,
        progress=progress,
    )
    return Result(
        found=replace(answer, seconds=monotonic() - began),
        _page=ANSWER,
        _summary=lambda one: f"{one.verdict.sentence} {one.caution}".strip(),
        _tables={"effects": effects_frame, "gap": gap_frame, "probabilities": probabilities_frame},
        _write=_write_answer,
    )


def _write_answer(folder: Path, answer: ExplainResult, _: Sequence[str]) -> list[Path]:
    written = write_folder(folder, answer)
    return [folder / PAGE, *map(Path, filter(None, [written.model]))]


def pitch_result(
    inputs: PitchInputs,
    controllers: Controllers | None = None,
    permit: CodePermit = check_code_allowed,
) -> Result[pitch_report.PitchStudy]:
    """Run the pitch bench under each controller. Tables: one of each, and `visits`.

    Args:
        controllers: in place of those of the inputs; classes as well as names.
        permit: called with each Python file before it is run.
    """
    names, own = split_controllers(
        inputs.controllers if controllers is None else controllers, PITCH_CONTROLLERS, permit
    )
    inputs.study.refuse_campaign()
    inputs = replace(inputs, controllers=names or ("pid",))
    setup = pitch_setup_of(inputs, inputs.study.gain_set(), permit)
    study = pitch_report.pitch_study(setup, inputs.study.seed, own, only_own=not names)
    rig = setup.bench.model.rig
    return Result(
        found=study,
        _page=pitch_report.PITCH,
        _summary=lambda one: "\n".join(pitch_report.report_lines(one)),
        _tables={
            run.controller: partial(lambda run, _: frame(run.recording(rig)), run)
            for run in study.runs
        }
        | {"visits": lambda one: frame_of_rows(pitch_report.visit_rows(one))},
        _write=lambda folder, one, _: pitch_report.write_study(one, folder),
    )


def flight_result(
    inputs: FlightInputs,
    controllers: Controllers | None = None,
    permit: CodePermit = check_code_allowed,
) -> Result[Sequence[FlownCase]]:
    """Fly a case under each controller. Tables: `oge` (PID over nothing) and one of each.

    Args:
        controllers: in place of those of the inputs; classes as well as names.
        permit: called with each Python file before it is run.
    """
    chosen = inputs.controllers or ("pid", "observer", "feedforward")
    names, own = split_controllers(
        chosen if controllers is None else controllers, FLIGHT_CONTROLLERS, permit
    )
    inputs.study.refuse_campaign()
    setup = flight_setup_of(inputs, inputs.study.gain_set(), permit)
    flights = flight_report.fly_each(setup.flown("pid", inputs.study.seed), names, own)
    titles = ["oge", *(name_of(one) for one in flights[1:])]
    return Result(
        found=flights,
        _page=flight_report.FLIGHT,
        _summary=lambda one: "\n".join(flight_report.report_lines(one)),
        _tables={
            title: partial(lambda one, _: frame(recording_of(one.flight)), one)
            for title, one in zip(titles, flights, strict=True)
        },
        _write=lambda folder, one, _: flight_report.write_flights(folder, one),
    )
