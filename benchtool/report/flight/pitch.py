"""Pitch angle against time under several controllers, green while a rotor is over the plate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from benchtool.core.array import Array
from benchtool.report.figure import Page, figure
from benchtool.report.flight.pitch_study import PitchStudy
from benchtool.report.palette import BLUE, GREY, VERMILION
from benchtool.report.panels import legend_below, rows_of, shade, spans
from benchtool.simulate.pitch.result import PitchRun


@dataclass(frozen=True, slots=True, eq=False)
class PitchTrace:
    """Hold one run, on a hinge or in flight.

    Attributes:
        label: heading of its panel ("observer").
        time_s, pitch_deg, reference_deg: (m,) each.
        covered: (m,) how far the plate is in, 0 to 1.
        away_deg: (m,) the same run with the plate parked (out of ground effect); None without.
    """

    label: str
    time_s: Array
    pitch_deg: Array
    reference_deg: Array
    covered: Array
    away_deg: Array | None = None

    @classmethod
    def on_hinge(cls, run: PitchRun, label: str, away: PitchRun | None = None) -> PitchTrace:
        """Return a run on the hinge, and beside it the one with the plate parked."""
        return cls(
            label,
            run.time_s,
            np.degrees(run.column("true_theta_rad")),
            np.degrees(run.column("reference_rad")),
            run.column("plate_share"),
            None if away is None else np.degrees(away.column("true_theta_rad")),
        )


def pitch_height(panels: int) -> float:
    """Return the height of so many panels, inches."""
    return 1.0 + 1.55 * panels


def draw_pitch(figure: Figure, traces: Sequence[PitchTrace]) -> None:
    """Draw one panel per run, all with the same axes, as in the paper's figures 26 to 28."""
    panels = rows_of(figure, [1.0] * len(traces), sharey=True)
    for axes, trace in zip(panels, traces, strict=True):
        shade(axes, spans(trace.time_s, trace.covered > 0.0), "over-plate")
        lines: list[tuple[Array | None, str, dict[str, Any]]] = [
            (trace.away_deg, "plate away (OGE)", {"color": BLUE, "lw": 0.9}),
            (trace.pitch_deg, "with the plate (IGE)", {"color": VERMILION, "lw": 1.2}),
        ]
        if np.ptp(trace.reference_deg) > 0.0:
            dashed = {"color": GREY, "lw": 1.0, "ls": "--"}
            lines.insert(0, (trace.reference_deg, "wanted", dashed))
        for values, label, look in lines:
            if values is not None:
                axes.plot(trace.time_s, values, label=label, **look)
        axes.set_title(trace.label)
        axes.set_ylabel("pitch [deg]\n(nose down +)")
    panels[-1].set_xlabel("time [s]    (green: a rotor is over the plate)")
    panels[0].set_xlim(float(traces[0].time_s[0]), float(traces[0].time_s[-1]))
    legend_below(figure, panels[:1], len(panels[0].get_legend_handles_labels()[1]))


@figure(
    page="flight.pitch",
    name="pitch",
    title="{0.setup.bench.model.rig.name}: {0.setup.schedule.title}",
    caption="Pitch under each controller, with the plate and without; green: a rotor is over it.",
    simulated=True,
    height_in=lambda study: pitch_height(len(study.runs)),
)
def pitch(figure: Figure, study: PitchStudy) -> None:
    """Draw the study as the paper lays out its figures 26 to 28."""
    pairs = zip(study.runs, study.away, strict=True)
    draw_pitch(figure, [PitchTrace.on_hinge(run, run.controller, away) for run, away in pairs])


PITCH = Page("flight.pitch", [("The pitch bench", ["pitch"])])
