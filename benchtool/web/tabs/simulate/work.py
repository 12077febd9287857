"""Simulate, in a process of its own: what `benchtool simulate --out` writes and prints."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchtool.core.inputs import to_arguments, with_changes
from benchtool.data.atomic import write_atomically
from benchtool.simulate.flight.inputs import FlightInputs
from benchtool.simulate.pitch.inputs import PitchInputs
from benchtool.web.jobs import PageSection, ReportProgress

if TYPE_CHECKING:
    from benchtool.report.result import Result

Simulation = PitchInputs | FlightInputs

DRAWN_FROM = 0.8  # share of a job at which the runs are done; assumed


def command_words(inputs: Simulation) -> list[str]:
    """Return the words behind `benchtool` that simulate the same."""
    kind = "pitch" if isinstance(inputs, PitchInputs) else "flight"
    return ["simulate", kind, *to_arguments(type(inputs), with_changes(inputs))]


def simulate_into(
    report: ReportProgress, out: Path, words: tuple[str, ...], inputs: Simulation
) -> tuple[PageSection, str]:
    """Simulate, write the folder in one step, and return the report and the first recording.

    Raises:
        BenchtoolError: inputs that cannot be simulated.
        WouldOverwrite: something of that name exists.
    """
    from benchtool.report.flight.flight import FLIGHT
    from benchtool.report.flight.pitch_study import PITCH
    from benchtool.report.page import Listing
    from benchtool.results import flight_result, pitch_result
    from benchtool.web.drawing import blocks_html

    report("simulating; the first time on a machine this compiles, up to a minute", 0.0)
    result: Result[Any]
    if isinstance(inputs, PitchInputs):
        result, page = pitch_result(inputs), PITCH
    else:
        result, page = flight_result(inputs), FLIGHT
    report("drawing", DRAWN_FROM)
    with write_atomically(out) as part:
        recording, *_ = result.save(part)
    head, *lines = result.summary().splitlines()
    blocks = [block for section in page.sections(result.found) for block in section.blocks]
    html = blocks_html([Listing(head, "\n".join(lines)), *blocks])
    section = PageSection(title=out.name, html=html, simulated=True, command=words)
    return section, f"{out.name}/{recording.name}" if page is PITCH else ""
