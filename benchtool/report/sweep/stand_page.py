"""Sections of a stand's recording: every sample, thrust against speed."""

from __future__ import annotations

import numpy as np

from benchtool.core.counted import counted
from benchtool.core.recording import Recording
from benchtool.report.numbers import numeral, unit_for_people
from benchtool.report.page import Block, FigureBlock, Paragraph, Section, Table
from benchtool.report.sweep.sweep import SweepTraces, sweep_figure
from benchtool.report.sweep.thrust import ThrustSeries, thrust_figure


def stand_sections(recording: Recording, name: str) -> tuple[list[Section], str]:
    """Return the sections of a recording without attitude, and its summary."""
    blocks: list[Block] = []
    if "time_s" in recording and "thrust_N" in recording:
        blocks.append(
            FigureBlock(
                sweep_figure(
                    SweepTraces.from_recording(recording),
                    title=f"Every sample: {name}",
                    simulated=recording.simulated,
                ),
                "Every sample of the recording, as it was imported.",
            )
        )
    if "thrust_N" in recording and "rpm1" in recording:
        speed, thrust = recording.si("rpm1"), recording.si("thrust_N")
        known = np.isfinite(speed) & np.isfinite(thrust)
        if known.any():
            series = ThrustSeries(
                float("inf"),
                speed[known],
                thrust[known],
                np.full(int(known.sum()), np.nan),
                named="samples of the recording",
            )
            blocks.append(
                FigureBlock(
                    thrust_figure(
                        [series],
                        title=f"Thrust against speed of rotor 1: {name}",
                        simulated=recording.simulated,
                    ),
                    "Thrust against rotor speed, sample by sample; no plate stands in the file.",
                )
            )
    if not blocks:
        blocks.append(Paragraph("It holds neither thrust nor attitude; its channels are below."))
    blocks.append(_ranges(recording))
    duration = ""
    if "time_s" in recording and np.isfinite(recording.si("time_s")).any():
        duration = f" over {np.nanmax(recording.si('time_s')):.4g} s"
    summary = (
        f"{name}: {counted(len(recording), 'row')} of {counted(len(recording.names), 'channel')}"
        f"{duration}."
    )
    if "thrust_N" in recording and np.isfinite(thrust := recording.si("thrust_N")).any():
        least, most = (numeral(of(thrust), ".4g") for of in (np.nanmin, np.nanmax))
        summary += f" Thrust from {least} to {most} N."
    return [Section("What was recorded", blocks)], summary


def _ranges(recording: Recording) -> Table:
    rows = []
    for channel in recording.channels:
        values = recording.column(channel.name)
        known = values[np.isfinite(values)]
        numbers = (
            [numeral(number, ".5g") for number in (known.min(), np.median(known), known.max())]
            if known.size
            else ["–"] * 3
        )
        unit = "µs" if channel.unit == "pwm_us" else unit_for_people(channel.unit)
        rows.append((channel.name, unit, str(known.size), *numbers))
    return Table(
        "What each channel holds.",
        ("channel", "unit", "values", "least", "median", "greatest"),
        rows,
        text_columns=2,
    )
