"""Simulation in a worker process, as `benchtool simulate --out`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchtool.core.inputs import to_arguments, with_changes
from benchtool.data.atomic import write_atomically
from benchtool.simulate.inputs import FlightInputs, PitchInputs
from benchtool.web.jobs import PageSection, ReportProgress

if TYPE_CHECKING:
    from benchtool.report.result import Result

Simulation = PitchInputs | FlightInputs

FIGURE_START_SHARE = 0.8  # of the progress; assumed


def command_arguments(inputs: Simulation) -> list[str]:
    """Return the arguments of the equivalent `benchtool simulate`."""
    kind = "pitch" if isinstance(inputs, PitchInputs) else "flight"
    return ["simulate", kind, *to_arguments(type(inputs), with_changes(inputs))]


def simulate_to_folder(
    report: ReportProgress, out: Path, command: tuple[str, ...], inputs: Simulation
) -> tuple[PageSection, str]:
    """Simulate, write the folder atomically and return the report and the first recording."""
    from benchtool.report.flight.flight import FLIGHT
    from benchtool.report.flight.pitch_study import PITCH
    from benchtool.report.page import Listing
    from benchtool.results import flight_result, pitch_result
    from benchtool.web.drawing import blocks_html

    report("simulating; the first run on a machine compiles for up to a minute", 0.0)
    result: Result[Any]
    if isinstance(inputs, PitchInputs):
        result, page = pitch_result(inputs), PITCH
    else:
        result, page = flight_result(inputs), FLIGHT
    report("drawing", FIGURE_START_SHARE)
    with write_atomically(out) as folder:
        recording, *_ = result.save(folder)
    head, *lines = result.summary().splitlines()
    blocks = [block for section in page.sections(result.found) for block in section.blocks]
    html = blocks_html([Listing(head, "\n".join(lines)), *blocks])
    section = PageSection(title=out.name, html=html, simulated=True, command=command)
    return section, f"{out.name}/{recording.name}" if page is PITCH else ""
