"""Results of fits, explanations and simulations, for the command line, the page and Python."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING

from benchtool.core.user_code import CodePermit, check_code_allowed
from benchtool.data.columns import rows_to_frame, to_frame
from benchtool.report.result import (
    Result,
    effects_frame,
    estimates_frame,
    gap_frame,
    probabilities_frame,
)

# Each function imports what it needs: all imports together take longer than most commands run.
if TYPE_CHECKING:
    from benchtool.explain.engine.posterior import Progress
    from benchtool.explain.inputs import ExplainInputs
    from benchtool.explain.request import Request
    from benchtool.explain.result import Explanation
    from benchtool.fit.recipe import FitInputs
    from benchtool.report.compare.pooled import PooledFits
    from benchtool.report.fit.result import Fit
    from benchtool.report.flight.pitch_study import PitchStudy
    from benchtool.simulate.controllers.controller import Controllers
    from benchtool.simulate.flight.study import FlownCase
    from benchtool.simulate.inputs import FlightInputs, PitchInputs


def fit_result(
    inputs: FitInputs,
    progress: Callable[[str, int, int], None] = lambda stage, done, expected: None,
    permit: CodePermit = check_code_allowed,
) -> Fit:
    """Fit a recipe; raise WouldOverwrite for an output folder that is not empty.

    `progress` is called with the stage, the steps done and the expected steps.
    """
    from benchtool.fit.run_recipe import run_recipe
    from benchtool.report.fit.budget import main_sources
    from benchtool.report.fit.figures import ratio_rows
    from benchtool.report.fit.page import FIT, refuse_full, sentence, write_fit
    from benchtool.report.fit.result import Fit

    if inputs.out is not None:
        refuse_full(inputs.out)
    output = run_recipe(
        inputs.recipe, progress, profile=inputs.profile, budget=inputs.budget, permit=permit
    )
    return Fit(
        found=output,
        _page=FIT,
        _summary=lambda fit: "\n".join([sentence(fit), *main_sources(fit.budget)]),
        _tables={
            "estimates": estimates_frame,
            "points": lambda output: to_frame(output.data.points),
            "ratio": lambda output: rows_to_frame(ratio_rows(output)),
        },
        _write=lambda folder, output, commands: [write_fit(folder, output, commands)],
    )


def pool_result(
    folders: Sequence[Path], of: Sequence[str] = (), shared: Sequence[str] = (), seed: int = 1
) -> Result[PooledFits]:
    """Pool fits of several rigs; see `pool_fits`."""
    from benchtool.report.compare import pooled as pooling

    return Result(
        found=pooling.pool_fits(folders, of, shared, seed=seed),
        _page=pooling.POOL,
        _summary=pooling.summary,
        _tables={
            "rigs": lambda fits: rows_to_frame(pooling.rigs_rows(fits)),
            "differences": lambda fits: rows_to_frame(pooling.differences_rows(fits)),
        },
        _write=pooling.write_pool,
    )


def explain_result(
    inputs: ExplainInputs,
    progress: Progress = lambda stage, fraction: None,
    permit: CodePermit = check_code_allowed,
    *,
    request: Request | None = None,
    minutes: float | None = None,
    commands: Sequence[str] = (),
) -> Result[Explanation]:
    """Identify effects that a model lacks.

    Args:
        progress: called with the stage and the completed fraction.
        request: data of the inputs, if already read.
        minutes: available for further experiments; None without experiments.
    """
    from benchtool.explain.request import read_request
    from benchtool.report.answer.page import ANSWER

    start_s = monotonic()
    request = read_request(inputs, permit) if request is None else request
    answer = request.explain(commands, minutes=minutes, progress=progress)
    return Result(
        found=replace(answer, seconds=monotonic() - start_s),
        _page=ANSWER,
        _summary=lambda answer: f"{answer.sentence} {answer.caution}".strip(),
        _tables={"effects": effects_frame, "gap": gap_frame, "probabilities": probabilities_frame},
        _write=_write_answer,
    )


def _write_answer(folder: Path, answer: Explanation, _: Sequence[str]) -> list[Path]:
    from benchtool.report.answer.folder import write_folder
    from benchtool.report.page import PAGE

    written = write_folder(folder, answer)
    return [folder / PAGE, *(Path(path) for kind, path in written.items() if kind == "model")]


def pitch_result(
    inputs: PitchInputs,
    controllers: Controllers | None = None,
    permit: CodePermit = check_code_allowed,
) -> Result[PitchStudy]:
    """Simulate the pitch bench with each controller, default: those of the inputs."""
    from benchtool.report.flight import pitch_study as pitch_report
    from benchtool.simulate.controllers.controller import split_controllers
    from benchtool.simulate.controllers.laws import PITCH_CONTROLLERS
    from benchtool.simulate.pitch.setup import pitch_setup

    names, user_controllers = split_controllers(
        inputs.controllers if controllers is None else controllers, PITCH_CONTROLLERS, permit
    )
    inputs.study.check_no_campaign()
    inputs = replace(inputs, controllers=names or ("pid",))
    setup = pitch_setup(inputs, inputs.study.gain_set(), permit)
    study = pitch_report.pitch_study(
        setup, inputs.study.seed, user_controllers, only_user_controllers=not names
    )
    rig = setup.bench.model.rig
    visits = {"visits": lambda study: rows_to_frame(pitch_report.visit_rows(study))}
    return Result(
        found=study,
        _page=pitch_report.PITCH,
        _summary=lambda study: "\n".join(pitch_report.report_lines(study)),
        _tables={
            run.controller: partial(lambda run, _: to_frame(run.recording(rig)), run)
            for run in study.runs
        }
        | (visits if setup.schedule.plate else {}),
        _write=lambda folder, study, _: pitch_report.write_study(study, folder),
    )


def flight_result(
    inputs: FlightInputs,
    controllers: Controllers | None = None,
    permit: CodePermit = check_code_allowed,
) -> Result[Sequence[FlownCase]]:
    """Simulate flights with each controller, default: those of the inputs."""
    from benchtool.report.flight import flight as flight_report
    from benchtool.simulate.controllers.controller import split_controllers
    from benchtool.simulate.controllers.laws import FLIGHT_CONTROLLERS
    from benchtool.simulate.flight.setup import flight_setup
    from benchtool.simulate.flight.study import build_recording, controller_label

    default = inputs.controllers or ("pid", "observer", "feedforward")
    names, user_controllers = split_controllers(
        default if controllers is None else controllers, FLIGHT_CONTROLLERS, permit
    )
    inputs.study.check_no_campaign()
    setup = flight_setup(inputs, inputs.study.gain_set(), permit)
    flights = flight_report.fly_each(
        setup.build_case("pid", inputs.study.seed), names, user_controllers
    )
    titles = ["oge", *(controller_label(flight) for flight in flights[1:])]
    return Result(
        found=flights,
        _page=flight_report.FLIGHT,
        _summary=lambda cases: "\n".join(flight_report.report_lines(cases)),
        _tables={
            title: partial(lambda case, _: to_frame(build_recording(case.flight)), case)
            for title, case in zip(titles, flights, strict=True)
        },
        _write=lambda folder, cases, _: flight_report.write_flights(folder, cases),
    )
