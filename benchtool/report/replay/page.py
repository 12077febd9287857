"""Report pages of a recording: log with simulated run, or test stand channels."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchtool.core.text import pluralize
from benchtool.core.units import Array, from_si
from benchtool.data.derived import build_recording_context, derive_quantities
from benchtool.explain.pitch.replay import Replay, ReplayInputs, run_replay
from benchtool.explain.pitch.replay_track import PitchTrack, pitch_track, resample_to_log
from benchtool.fit.data_rig import rig_for_data
from benchtool.report.figure import Page, figure
from benchtool.report.numbers import display_unit, format_number
from benchtool.report.page import Block, Paragraph, Report, Table, Warnings
from benchtool.report.palette import BLACK
from benchtool.report.quantities import origins_table
from benchtool.report.replay.figures import ReplayedLog
from benchtool.report.replay.replay_source import ReplaySource, read_recorded, sections_behind
from benchtool.report.sweep.samples import draw_samples, samples_height


def _has_samples(recorded: ReplaySource) -> bool:
    return "time_s" in recorded.recording and "thrust_N" in recorded.recording


@figure(
    page="replay.stand",
    title="Samples: {0.name}",
    caption="Samples of the recording after import.",
    when=_has_samples,
    height_in=lambda recorded: samples_height(recorded.recording),
)
def samples(figure: Figure, recorded: ReplaySource) -> None:
    """Draw the signals of a recording as stacked panels."""
    draw_samples(figure, recorded.recording)


def _has_thrust_and_speed(recorded: ReplaySource) -> NDArray[np.bool_]:
    recording = recorded.recording
    if "thrust_N" not in recording or "rpm1" not in recording:
        return np.zeros(len(recording), bool)
    return np.isfinite(recording.to_si("rpm1")) & np.isfinite(recording.to_si("thrust_N"))


@figure(
    page="replay.stand",
    title="Thrust against speed of rotor 1: {0.name}",
    caption="Thrust against rotor speed per sample; the file contains no plate distance.",
    when=lambda recorded: bool(_has_thrust_and_speed(recorded).any()),
    height_in=4.4,
)
def thrust(figure: Figure, recorded: ReplaySource) -> None:
    """Draw thrust against rotor speed."""
    axes, rows = figure.subplots(), _has_thrust_and_speed(recorded)
    rpm = from_si(recorded.recording.to_si("rpm1")[rows], "rpm")
    thrust_N = recorded.recording.to_si("thrust_N")[rows]
    axes.plot(rpm, thrust_N, "s", ms=4.2, color=BLACK, label="samples of the recording")
    axes.set_ylabel("thrust [N]")
    axes.set_xlabel("rotor speed [rpm]")
    axes.legend(loc="upper left")


def _quantities(recorded: ReplaySource) -> Block | None:
    if recorded.is_run:
        return None
    quantities = derive_quantities(
        recorded.recording, build_recording_context(recorded.facts, str(recorded.path))
    )
    return origins_table(quantities) if quantities else None


def _nothing_drawn(recorded: ReplaySource) -> Block | None:
    if _has_samples(recorded) or _has_thrust_and_speed(recorded).any():
        return None
    return Paragraph("The recording contains neither thrust nor attitude; see the channels below.")


def _ranges(recorded: ReplaySource) -> Block:
    rows = []
    for channel in recorded.recording.channels:
        values = recorded.recording.column(channel.name)
        finite = values[np.isfinite(values)]
        numbers = ["–"] * 3
        if finite.size:
            numbers = [
                format_number(statistic(finite), ".5g") for statistic in (np.min, np.median, np.max)
            ]
        unit = "µs" if channel.unit == "pwm_us" else display_unit(channel.unit)
        rows.append((channel.name, unit, str(finite.size), *numbers))
    heads = ("channel", "unit", "values", "minimum", "median", "maximum")
    return Table("Range of each channel.", heads, rows, text_columns=2)


def stand_summary(recorded: ReplaySource) -> str:
    """Return a summary of a recording without attitude."""
    recording = recorded.recording
    duration = ""
    if "time_s" in recording and np.isfinite(recording.to_si("time_s")).any():
        duration = f" over {np.nanmax(recording.to_si('time_s')):.4g} s"
    rows, channels = pluralize(len(recording), "row"), pluralize(len(recording.names), "channel")
    summary = f"{recorded.name}: {rows} of {channels}{duration}."
    if "thrust_N" in recording and np.isfinite(thrust := recording.to_si("thrust_N")).any():
        minimum, maximum = (
            format_number(statistic(thrust), ".4g") for statistic in (np.nanmin, np.nanmax)
        )
        summary += f" Thrust from {minimum} to {maximum} N."
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


def recording_page(path: Path, replay_inputs: ReplayInputs, commands: Sequence[str] = ()) -> Report:
    """Return the report page of a recording; with a model, it includes a simulated run."""
    recorded = read_recorded(path)
    if not {"theta_rad", "time_s"} <= set(recorded.recording.names):
        replay_inputs.check_unused("this recording has no attitude")
        return STAND.report(recorded, commands)
    track = pitch_track(recorded.recording, replay_inputs.motors)
    replay, missing = None, list[str]()
    if replay_inputs.model:
        rig = rig_for_data([str(recorded.path)], replay_inputs.model, replay_inputs.rig)
        replay, missing = run_replay(track, replay_inputs, recorded.provenance, rig)
    log = ReplayedLog(recorded, track, replay_inputs, replay, [*missing, *track.remarks])
    return REPLAY.report(log, commands)


def errors_deg(track: PitchTrack, replay: Replay | None) -> tuple[Array, Array]:
    """Return pitch errors (n,) of log and simulated run from reference or median: deg."""
    target_rad = track.reference_rad
    if not np.isfinite(target_rad).any():
        target_rad = np.full(len(track), np.nanmedian(track.theta_rad))
    recorded = np.degrees(track.theta_rad - target_rad)
    if replay is None:
        return recorded, np.full(len(track), np.nan)
    theta = resample_to_log(track, replay.time_s, replay.theta_rad)
    return recorded, np.degrees(theta - target_rad)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.nanmean(values**2))) if np.isfinite(values).any() else float("nan")


def _peak(values: Array) -> float:
    if not np.isfinite(values).any():
        return float("nan")
    return float(values[int(np.nanargmax(np.abs(values)))])


def _rms_and_peak(errors: Array) -> tuple[str, ...]:
    # Adding 0 removes the sign of a zero.
    return tuple(
        format_number(round(statistic(errors), 2) + 0.0, ".2f") for statistic in (_rms, _peak)
    )


def visits_table(log: ReplayedLog) -> Table | None:
    """Return a table of pitch errors per surface interval and outside."""
    track = log.track
    if not track.visits:
        return None
    recorded, simulated = errors_deg(log.track, log.replay)
    is_simulated = log.replay is not None and not log.replay.warning
    inside = [
        (f"{start_s:.2f} … {end_s:.2f}", log.rotors(first, last), np.arange(first, last + 1))
        for (start_s, end_s), (first, last) in zip(log.intervals, track.visits, strict=True)
    ]
    outside = ("outside", "none", np.flatnonzero(track.max_coverage <= 0.0))
    rows = [
        (
            span,
            rotors,
            *_rms_and_peak(recorded[part]),
            *(_rms_and_peak(simulated[part]) if is_simulated else ()),
        )
        for span, rotors, part in (*inside, outside)
    ]
    baseline = "reference" if np.isfinite(track.reference_rad).any() else "median of the log"
    heads = ("time [s]", "rotors over surface", "RMS", "largest")
    return Table(
        f"Pitch minus {baseline}, in degrees, positive nose down.",
        (*heads, *(("simulated RMS", "simulated largest") if is_simulated else ())),
        rows,
        text_columns=2,
    )


def _title(log: ReplayedLog) -> str:
    kind = "Pitch recording" if log.recorded.is_run else "Replayed log"
    return f"{kind}: {log.recorded.name}"


def _sentence(log: ReplayedLog) -> str:
    track, replay = log.track, log.replay
    recorded, simulated = errors_deg(log.track, log.replay)
    inside = track.max_coverage > 0.0
    duration_s = len(track) / track.rate_Hz
    text = f"{log.recorded.name}: {duration_s:.4g} s of pitch, RMS error {_rms(recorded):.2f}°"
    if inside.any():
        text += (
            f"; over a surface in {pluralize(len(track.visits), 'interval')} "
            f"({inside.sum() / track.rate_Hz:.4g} s): RMS {_rms(recorded[inside]):.2f}°, maximum "
            f"{format_number(_peak(recorded[inside]), '+.2f')}°"
        )
    if replay is not None and replay.warning:
        text += f". The run simulated with {replay.model} deviates from the log and is not valid"
    elif replay is not None and np.isfinite(simulated).any():
        part = inside if inside.any() else np.ones(len(track), bool)
        scope = " over the surface" if inside.any() else ""
        text += f". Simulated with {replay.model}: {_rms(simulated[part]):.2f}°{scope}"
    return text + "."


def _highlights(log: ReplayedLog) -> dict[str, str]:
    replay = log.replay
    recorded, simulated = errors_deg(log.track, log.replay)
    inside = log.track.max_coverage > 0.0
    tiles = {"RMS pitch error": f"{_rms(recorded):.2f}°"}
    if inside.any():
        tiles = {
            "RMS pitch error, over a surface": f"{_rms(recorded[inside]):.2f}°",
            "elsewhere": f"{_rms(recorded[~inside]):.2f}°",
        }
    if replay is not None and replay.warning:
        tiles["simulated run"] = "deviates from the log"
    elif replay is not None:
        part = inside if inside.any() else np.ones(len(inside), bool)
        name = "simulated RMS error" + (", over a surface" if inside.any() else "")
        tiles[name] = f"{_rms(simulated[part]):.2f}°"
        if replay.driven_by == "pulses":
            tiles["recorded − simulated, RMS"] = f"{_rms(recorded - simulated):.2f}°"
    return tiles


NO_BUDGET = Paragraph(
    "This page contains no fit and no uncertainty budget. benchtool explain estimates missing "
    "effects from a pitch recording with standard uncertainties."
)
REPLAY = Page(
    "replay",
    [
        (
            "The log and its simulated run",
            [
                lambda log: Warnings(log.warnings),
                "log",
                "closer",
                visits_table,
                lambda _: NO_BUDGET,
            ],
        ),
        lambda log: sections_behind(log.recorded),
    ],
    title=_title,
    summary=_sentence,
    highlights=_highlights,
)
