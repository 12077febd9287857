"""Jobs of the Fit, Explain and Simulate tabs, as their commands with --out."""

from __future__ import annotations

import shlex
import shutil
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from benchtool.core.errors import InputError
from benchtool.core.inputs import Inputs, to_arguments, with_changes
from benchtool.data.atomic import complete_folder, partial_folder, write_atomically
from benchtool.explain.inputs import ExplainInputs
from benchtool.fit.recipe import FitInputs
from benchtool.simulate.inputs import FlightInputs, PitchInputs
from benchtool.tasks import Job, ReportProgress
from benchtool.web.drawing import PageSection, Tiles, Verdict, as_html
from benchtool.web.entries import view_fit

if TYPE_CHECKING:
    from benchtool.report.result import Result

Simulation = PitchInputs | FlightInputs

FIGURE_START_SHARE = 0.85  # of the progress; assumed
NICENESS = 5  # of a job; assumed


class CommandJob(Job):
    """Job that writes a folder; function(report, out, command, *arguments).

    An explanation is in a folder with a hidden name until the user accepts it: `accepted_model` is
    None until then, afterwards the name of the new model or "".
    """

    accepted_model: str | None = None

    def __init__(
        self, out: Path, command: Sequence[str], function: Callable[..., Any], *arguments: Any
    ) -> None:
        self.out, self.command = out, tuple(command)
        super().__init__(function, out, self.command, *arguments, niceness=NICENESS)

    def cancel(self) -> bool:
        """End the process if it is running and delete the partial folder."""
        is_cancelled = super().cancel()
        shutil.rmtree(partial_folder(self.out), ignore_errors=True)
        return is_cancelled

    def accept(self, out: Path) -> None:
        """Rename the hidden folder to `out`; raise if it exists or without a result."""
        from benchtool.explain.next_steps import MODEL
        from benchtool.physics.model_file import load_model

        if not self.succeeded:
            raise InputError("there is no result to accept; press Explain first")
        if self.accepted_model is not None:
            raise InputError(f"{self.out.name} is accepted already; open it under Runs")
        complete_folder(self.out, out)
        model = out / MODEL
        self.accepted_model = load_model(model).model.name if model.is_file() else ""
        self.out = out


def fit_to_folder(
    report: ReportProgress, out: Path, command: tuple[str, ...], inputs: FitInputs
) -> PageSection:
    """Run a recipe, write its folder atomically and return its report."""
    from benchtool.results import fit_result

    report("reading", 0.0)
    result = fit_result(
        inputs, lambda stage, done, expected: report(stage, done / max(expected, 1))
    )
    report("drawing", 0.0)
    with write_atomically(out) as folder:
        result.save(folder, [shlex.join(["benchtool", *command])])
    return replace(view_fit(out.parent, out.name), command=command)


def simulate_to_folder(
    report: ReportProgress, out: Path, command: tuple[str, ...], inputs: Simulation
) -> tuple[PageSection, str]:
    """Simulate, write the folder atomically and return the report and the first recording."""
    from benchtool.physics.expression import watch_compilation
    from benchtool.report.flight.flight import FLIGHT
    from benchtool.report.flight.pitch_study import PITCH
    from benchtool.report.page import Listing
    from benchtool.results import flight_result, pitch_result

    report("simulating", 0.0)
    result: Result[Any]
    with watch_compilation(
        lambda share: report("compiling, once per installation", FIGURE_START_SHARE * share)
    ):
        if isinstance(inputs, PitchInputs):
            result, page = pitch_result(inputs), PITCH
        else:
            result, page = flight_result(inputs), FLIGHT
    report("drawing", FIGURE_START_SHARE)
    with write_atomically(out) as folder:
        recording, *_ = result.save(folder)
    head, *lines = result.summary().splitlines()
    blocks = [block for section in page.sections(result.found) for block in section.blocks]
    blocks = [Listing(head, "\n".join(lines)), *blocks]
    section = PageSection(out.name, as_html(*blocks), simulated=True, command=command)
    return section, f"{out.name}/{recording.name}" if page is PITCH else ""


class Explanation(NamedTuple):
    """Result of an explanation for the page."""

    head: PageSection  # verdict with its cautions, most important values
    section: PageSection
    new_effects: tuple[str, ...]  # added to the model; () if none was identified
    seconds: float


def explain(
    report: ReportProgress, out: Path, command: tuple[str, ...], inputs: ExplainInputs
) -> Explanation:
    """Identify the effect that a model lacks and write the result to a hidden folder."""
    from benchtool.explain.next_steps import added_effects, next_file
    from benchtool.report.answer.folder import write_folder
    from benchtool.report.answer.page import added_sentence, answer_page
    from benchtool.report.figure import render_figures
    from benchtool.results import explain_result

    def progress(stage: str, share: float) -> None:
        if share < 1.0:
            report(stage, FIGURE_START_SHARE * share)

    report("reading the recordings", 0.0)
    answer = explain_result(inputs, progress, commands=[shlex.join(["benchtool", *command])]).found
    report("drawing the figures", FIGURE_START_SHARE)
    hidden_folder = partial_folder(out)
    shutil.rmtree(hidden_folder, ignore_errors=True)
    write_folder(hidden_folder, answer, display_path=out)
    page = answer_page(answer, render_figures("answer", answer), next_file(answer)[0])
    now, where, *others = page.sections
    # The page shows this sentence next to its button, as its text changes.
    skipped_blocks = [added_sentence(answer)] if answer.effects else []
    next_blocks = [block for block in now.blocks if block not in skipped_blocks]
    verdict, tiles = Verdict(page.summary), Tiles(page.highlights)
    head = PageSection("Result", as_html(verdict, tiles), simulated=answer.simulated)
    details = [PageSection(section.title, as_html(*section.blocks)) for section in others]
    html = as_html(*where.blocks, *next_blocks)
    section = PageSection("", html, command=command, details=details)
    effects = tuple(effect.name for effect in added_effects(answer))
    return Explanation(head, section, effects, answer.seconds)


JOBS: dict[type[Inputs], tuple[list[str], Callable[..., Any]]] = {
    FitInputs: (["fit"], fit_to_folder),
    ExplainInputs: (["explain"], explain),
    PitchInputs: (["simulate", "pitch"], simulate_to_folder),
    FlightInputs: (["simulate", "flight"], simulate_to_folder),
}


def command_arguments(inputs: Inputs) -> list[str]:
    """Return the arguments of the equivalent `benchtool` command."""
    return JOBS[type(inputs)][0] + to_arguments(type(inputs), with_changes(inputs))


def start_command(out: Path, inputs: Inputs) -> CommandJob:
    """Start the job of a command."""
    return CommandJob(out, command_arguments(inputs), JOBS[type(inputs)][1], inputs)
