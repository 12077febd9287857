"""The report page of a recording: what a log holds, and the simulated run beside it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchtool import __version__
from benchtool.core.schedule import PARKED_M
from benchtool.data.run.run_rig import rig_of_data
from benchtool.explain.pitch.replay_judged import on_log_clock
from benchtool.explain.pitch.replay_track import PitchTrack, pitch_track
from benchtool.explain.pitch.replayed import Beside, Replay, replayed
from benchtool.report.numbers import numeral
from benchtool.report.page import (
    Block,
    Commands,
    FigureBlock,
    Report,
    Section,
    Table,
    Warnings,
)
from benchtool.report.replay.recorded import Recorded, read_recorded, sections_behind
from benchtool.report.replay.replay import ReplayTrace, closer_figure, replay_figure
from benchtool.report.sweep.stand_page import stand_sections

Array = NDArray[np.float64]


def recording_page(path: Path, beside: Beside, commands: Sequence[str]) -> Report:
    """Return the report page of a recording; with a model, its simulated run beside it."""
    recorded = read_recorded(path)
    recording = recorded.recording
    if "theta_rad" in recording and "time_s" in recording:
        sections, summary, highlights = _pitch_sections(recorded, beside)
        title = "Pitch recording" if recorded.is_run else "Replayed log"
    else:
        beside.refuse_controller("this recording has no attitude")
        sections, summary = stand_sections(recording, recorded.name)
        highlights, title = {}, "Recording"
    return Report(
        title=f"{title}: {recorded.name}",
        summary=summary,
        sections=(
            *sections,
            *sections_behind(recorded),
            Section("Made with", [Commands(commands)]),
        ),
        simulated=recording.simulated,
        made=f"benchtool {__version__}",
        highlights=highlights,
    )


def _pitch_sections(
    recorded: Recorded, beside: Beside
) -> tuple[list[Section], str, dict[str, str]]:
    track = pitch_track(recorded.recording, beside.motors)
    replay: Replay | None = None
    warned = list(track.remarks)
    if beside.model:
        rig = rig_of_data([str(recorded.path)])
        replay, lacks = replayed(track, beside, recorded.provenance, rig)
        warned = [*lacks, *warned]
    trace = trace_of(track, replay)
    simulated = recorded.recording.simulated
    caption = (
        "Pitch against its reference, and what else the log holds; green: a rotor is over a "
        f"surface, as in the paper's figures 26 to 30. {_beside_words(replay, beside)}"
    )
    blocks: list[Block] = [
        Warnings(warned),
        FigureBlock(
            replay_figure(trace, title=f"The log: {recorded.name}", simulated=simulated), caption
        ),
    ]
    if trace.over:
        blocks.append(
            FigureBlock(
                closer_figure(trace, title="Closer, over the surface", simulated=simulated),
                f"The same around each green stretch. {_beside_words(replay, beside)}",
            )
        )
        blocks.append(visits_table(track, replay))
    summary = _sentence(track, replay, recorded.name)
    return [Section("The log and its simulated run", blocks)], summary, _highlights(track, replay)


def _beside_words(replay: Replay | None, beside: Beside) -> str:
    if replay is not None:
        follows = " It does not follow the log." if replay.missed else ""
        return (
            f"Simulated beside it: model {replay.model} on rig {replay.rig}; {replay.words}."
            f"{follows}"
        )
    if beside.model:
        return "No simulated run stands beside it; the warnings say what it lacks."
    return "No model was named, so no simulated run stands beside it (--model)."


def trace_of(track: PitchTrack, replay: Replay | None) -> ReplayTrace:
    """Return a recording and its simulated run in the units of the figure."""
    over = [
        ((float(track.time_s[first]), float(track.time_s[last])), _rotors(track, first, last))
        for first, last in track.visits
    ]
    height = track.distance_m
    if not np.isfinite(height).any() and (track.plate_z_m < PARKED_M).any():
        height = np.where(track.plate_z_m < PARKED_M, track.plate_z_m, np.nan)
    known = {}
    if replay is not None:
        known = {
            "sim_time_s": replay.time_s,
            "sim_pitch_deg": np.degrees(replay.theta_rad),
            "sim_pwm_us": replay.pwm_us,
            "sim_disturbance_mNm": 1e3 * replay.disturbance_Nm
            if np.isfinite(track.disturbance_Nm).any()
            else np.empty(0),
        }
    label = ""
    if replay is not None:
        how = "closed loop" if replay.by == "controller" else "logged pulses"
        label = f"simulated, {'does not follow the log' if replay.missed else how}"
    return ReplayTrace(
        time_s=track.time_s,
        pitch_deg=np.degrees(track.theta_rad),
        reference_deg=np.degrees(track.reference_rad),
        over=over,
        pwm_us=track.pwm_us,
        rpm=track.rpm,
        torque_mNm=1e3 * track.torque_Nm,
        disturbance_mNm=1e3 * track.disturbance_Nm,
        height_m=height,
        sim_label=label or "simulated",
        **known,
    )


def _rotors(track: PitchTrack, first: int, last: int) -> str:
    rotors = track.rotors_over(first, last)
    if len(rotors) == len(track.over) > 1:
        return "all"
    return ", ".join(map(str, rotors))


def errors_deg(track: PitchTrack, replay: Replay | None) -> tuple[Array, Array]:
    """Return pitch errors (n,) of the log and of the simulated run on the log's clock: deg.

    The error is from the reference, or from the log's median where none is logged.
    """
    wanted = track.reference_rad
    if not np.isfinite(wanted).any():
        wanted = np.full(len(track), np.nanmedian(track.theta_rad))
    recorded = np.degrees(track.theta_rad - wanted)
    if replay is None:
        return recorded, np.full(len(track), np.nan)
    theta = on_log_clock(track, replay.time_s, replay.theta_rad)
    return recorded, np.degrees(theta - wanted)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.nanmean(values**2))) if np.isfinite(values).any() else float("nan")


def _peak(values: Array) -> float:
    if not np.isfinite(values).any():
        return float("nan")
    return float(values[int(np.nanargmax(np.abs(values)))])


def _shown(value: float) -> str:
    # Adding 0 takes the sign off a zero.
    return numeral(round(value, 2) + 0.0, ".2f")


def _rms_and_peak(errors: Array) -> tuple[str, str]:
    return _shown(_rms(errors)), _shown(_peak(errors))


def visits_table(track: PitchTrack, replay: Replay | None) -> Table:
    """List the errors of the pitch in each green stretch and outside of all.

    A simulated run that does not follow the log has no columns here.
    """
    recorded, simulated = errors_deg(track, replay)
    beside = replay is not None and not replay.missed
    outside = track.any_over <= 0.0
    stretches = [
        (
            f"{track.time_s[first]:.2f} … {track.time_s[last]:.2f}",
            _rotors(track, first, last),
            np.arange(first, last + 1),
        )
        for first, last in track.visits
    ]
    rows = [
        (
            span,
            rotors,
            *_rms_and_peak(recorded[part]),
            *(_rms_and_peak(simulated[part]) if beside else ()),
        )
        for span, rotors, part in [*stretches, ("outside of them", "none", np.flatnonzero(outside))]
    ]
    wanted = "reference" if np.isfinite(track.reference_rad).any() else "log's median"
    return Table(
        f"Pitch minus {wanted}, in degrees, positive nose down.",
        (
            *("time [s]", "rotors over it", "RMS", "largest"),
            *(("simulated RMS", "simulated largest") if beside else ()),
        ),
        rows,
        text_columns=2,
    )


def _sentence(track: PitchTrack, replay: Replay | None, name: str) -> str:
    recorded, simulated = errors_deg(track, replay)
    inside = track.any_over > 0.0
    duration_s = len(track) / track.rate_Hz
    words = f"{name}: {duration_s:.4g} s of pitch, RMS error {_rms(recorded):.2f}°"
    if inside.any():
        words += (
            f"; over a surface in {len(track.visits)} "
            f"stretch{'es' if len(track.visits) > 1 else ''} ({inside.sum() / track.rate_Hz:.4g} "
            f"s), there {_rms(recorded[inside]):.2f}° and at most "
            f"{numeral(_peak(recorded[inside]), '+.2f')}°"
        )
    if replay is not None and replay.missed:
        words += f". A run simulated with {replay.model} does not follow the log and is no result"
    elif replay is not None and np.isfinite(simulated).any():
        part = inside if inside.any() else np.ones(len(track), bool)
        words += f". Simulated with {replay.model}: {_rms(simulated[part]):.2f}°" + (
            " there" if inside.any() else ""
        )
    return words + "."


def _highlights(track: PitchTrack, replay: Replay | None) -> dict[str, str]:
    recorded, simulated = errors_deg(track, replay)
    inside = track.any_over > 0.0
    shown = {"RMS pitch error": f"{_rms(recorded):.2f}°"}
    if inside.any():
        shown = {
            "RMS pitch error, over a surface": f"{_rms(recorded[inside]):.2f}°",
            "elsewhere": f"{_rms(recorded[~inside]):.2f}°",
        }
    if replay is not None and replay.missed:
        shown["simulated run"] = "does not follow the log"
    elif replay is not None:
        part = inside if inside.any() else np.ones(len(track), bool)
        shown["simulated RMS error" + (", over it" if inside.any() else "")] = (
            f"{_rms(simulated[part]):.2f}°"
        )
        if replay.by == "pulses":
            shown["recorded − simulated, RMS"] = f"{_rms(recorded - simulated):.2f}°"
    return shown
