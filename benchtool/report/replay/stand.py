"""The page of a stand's recording: every sample, thrust against speed, what each channel holds."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchtool.core.counted import counted
from benchtool.core.units import from_si
from benchtool.data.derived import derive, recording_circumstances
from benchtool.report.figure import Page, figure
from benchtool.report.numbers import numeral, unit_for_people
from benchtool.report.page import Block, Paragraph, Table
from benchtool.report.palette import BLACK
from benchtool.report.quantities import origins_table
from benchtool.report.replay.recorded import Recorded, sections_behind
from benchtool.report.sweep.samples import draw_samples, samples_height


def _has_samples(recorded: Recorded) -> bool:
    return "time_s" in recorded.recording and "thrust_N" in recorded.recording


@figure(
    page="replay.stand",
    name="samples",
    title="Every sample: {0.name}",
    caption="Every sample of the recording, as it was imported.",
    when=_has_samples,
    height_in=lambda recorded: samples_height(recorded.recording),
)
def samples(figure: Figure, recorded: Recorded) -> None:
    """Draw the signals of a recording one above the other."""
    draw_samples(figure, recorded.recording)


def _known(recorded: Recorded) -> NDArray[np.bool_]:
    recording = recorded.recording
    if "thrust_N" not in recording or "rpm1" not in recording:
        return np.zeros(len(recording), bool)
    return np.isfinite(recording.si("rpm1")) & np.isfinite(recording.si("thrust_N"))


@figure(
    page="replay.stand",
    name="thrust",
    title="Thrust against speed of rotor 1: {0.name}",
    caption="Thrust against rotor speed, sample by sample; no plate stands in the file.",
    when=lambda recorded: bool(_known(recorded).any()),
    height_in=4.4,
)
def thrust(figure: Figure, recorded: Recorded) -> None:
    """Draw thrust against rotor speed."""
    axes, rows = figure.subplots(), _known(recorded)
    rpm = from_si(recorded.recording.si("rpm1")[rows], "rpm")
    thrust_N = recorded.recording.si("thrust_N")[rows]
    axes.plot(rpm, thrust_N, "s", ms=4.2, color=BLACK, label="samples of the recording")
    axes.set_ylabel("thrust [N]")
    axes.set_xlabel("rotor speed [rpm]")
    axes.legend(loc="upper left")


def _quantities(recorded: Recorded) -> Block | None:
    if recorded.is_run:
        return None
    found = derive(recorded.recording, recording_circumstances(recorded.facts, str(recorded.path)))
    return origins_table(found) if found else None


def _nothing_drawn(recorded: Recorded) -> Block | None:
    if _has_samples(recorded) or _known(recorded).any():
        return None
    return Paragraph("It holds neither thrust nor attitude; its channels are below.")


def _ranges(recorded: Recorded) -> Block:
    rows = []
    for channel in recorded.recording.channels:
        values = recorded.recording.column(channel.name)
        known = values[np.isfinite(values)]
        numbers = ["–"] * 3
        if known.size:
            numbers = [numeral(of(known), ".5g") for of in (np.min, np.median, np.max)]
        unit = "µs" if channel.unit == "pwm_us" else unit_for_people(channel.unit)
        rows.append((channel.name, unit, str(known.size), *numbers))
    heads = ("channel", "unit", "values", "least", "median", "greatest")
    return Table("What each channel holds.", heads, rows, text_columns=2)


def stand_summary(recorded: Recorded) -> str:
    """Say in a sentence or two what a recording without attitude holds."""
    recording = recorded.recording
    duration = ""
    if "time_s" in recording and np.isfinite(recording.si("time_s")).any():
        duration = f" over {np.nanmax(recording.si('time_s')):.4g} s"
    rows, channels = counted(len(recording), "row"), counted(len(recording.names), "channel")
    summary = f"{recorded.name}: {rows} of {channels}{duration}."
    if "thrust_N" in recording and np.isfinite(thrust := recording.si("thrust_N")).any():
        least, most = (numeral(of(thrust), ".4g") for of in (np.nanmin, np.nanmax))
        summary += f" Thrust from {least} to {most} N."
    return summary


STAND = Page(
    "replay.stand",
    [
        ("What was recorded", ["samples", "thrust", _nothing_drawn, _ranges, _quantities]),
        sections_behind,
    ],
    title="Recording: {0.name}",
    summary=stand_summary,
)
