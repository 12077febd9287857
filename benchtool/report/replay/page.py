"""Page of a pitch or flight log with its simulated run, as in figures 26 to 30 of the paper."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from benchtool.core.schedule import PARKED_M
from benchtool.core.text import pluralize
from benchtool.core.units import Array
from benchtool.explain.pitch.replay import Replay, ReplayInputs, run_replay
from benchtool.explain.pitch.replay_track import PitchTrack, pitch_track, resample_to_log
from benchtool.fit.nominal import rig_for_data
from benchtool.report.figure import figure, legend_line, legend_patch
from benchtool.report.numbers import format_number
from benchtool.report.page import Page, Report, Table, Warnings
from benchtool.report.palette import BLACK, BLUE, GREY, OVER, VERMILION
from benchtool.report.panels import (
    broken_line,
    rotor_color,
    rotor_legend,
    shade,
    stack_panels,
)
from benchtool.report.replay.replay_source import (
    STAND,
    ReplaySource,
    read_recorded,
    sections_behind,
)

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


CLOSER_S = 5.0  # time shown before and after a surface interval
MARGIN = 0.75  # of the recorded range, above and below it
MIN_MARGIN_DEG = 1.0
MAX_CLOSER = 6  # surface intervals that are enlarged; the first ones


@dataclass(frozen=True, slots=True, eq=False)
class ReplayedLog:
    """Resampled recording with its simulated run."""

    recorded: ReplaySource
    track: PitchTrack
    inputs: ReplayInputs
    replay: Replay | None = None
    warnings: Sequence[str] = ()

    @property
    def simulated(self) -> bool:
        return self.recorded.recording.simulated

    @property
    def simulation(self) -> str:
        """One sentence on the simulated run."""
        replay = self.replay
        if replay is not None:
            remark = " It deviates from the log." if replay.warning else ""
            vehicle = f"model {replay.model} on rig {replay.rig}"
            return f"Simulated: {vehicle}; {replay.description}.{remark}"
        if self.inputs.model:
            return "Not simulated; see the warnings for missing data."
        return "Not simulated; a simulated run needs --model."

    @property
    def height_m(self) -> Array:
        """Distance sensor reading, else plate position (n,); nan when parked."""
        sensor, plate = self.track.distance_m, self.track.plate_z_m
        near = plate < PARKED_M
        if np.isfinite(sensor).any() or not near.any():
            return sensor
        return np.where(near, plate, np.nan)

    @property
    def intervals(self) -> list[tuple[float, float]]:
        """Start and end (s) of the intervals with a rotor over a surface."""
        time_s = self.track.time_s
        return [(float(time_s[first]), float(time_s[last])) for first, last in self.track.visits]

    def rotors(self, first: int, last: int) -> str:
        """Return the numbers of the rotors over a surface in a row range."""
        numbers = self.track.rotors_over(first, last)
        if len(numbers) == len(self.track.over) > 1:
            return "all"
        return ", ".join(map(str, numbers))


def _has_values(values: Array) -> bool:
    return bool(np.isfinite(values).any())


PITCH_LABEL = "pitch [deg]\n(nose down +)"
Panel: TypeAlias = "Callable[[Axes, ReplayedLog], None]"


def _panels(log: ReplayedLog) -> dict[str, Panel]:
    """Return the panels with data by the label of their y axis, from top to bottom."""
    track = log.track
    torque = _has_values(track.torque_Nm) or _has_values(track.disturbance_Nm)
    panels: list[tuple[bool, str, Panel]] = [
        (True, PITCH_LABEL, _pitch),
        (_has_values(track.pwm_us), "outputs\n[µs]", _pulses),
        (_has_values(track.rpm), "speeds\n[rpm]", _speeds),
        (torque, "torque\n[mN m]", _torque),
        (_has_values(log.height_m), "surface\nbelow [m]", _height),
    ]
    return {label: panel for has_data, label, panel in panels if has_data}


@figure(
    title="Log: {0.recorded.name}",
    caption="Pitch with its reference, and the other channels of the log; green: rotor over a "
    "surface, as in figures 26 to 30 of the paper. {0.simulation}",
    height_in=lambda log: 2.2 + 1.25 * len(_panels(log)),
)
def log(figure: Figure, log: ReplayedLog) -> None:
    """Draw the whole log: attitude, and below outputs, speeds, torque and height."""
    draw, time_s = _panels(log), log.track.time_s
    panels = stack_panels(figure, [2.0] + [1.0] * (len(draw) - 1), draw, "time [s]")
    for axes, panel in zip(panels, draw.values(), strict=True):
        shade(axes, log.intervals)
        panel(axes, log)
    panels[0].set_xlim(float(time_s[0]), float(time_s[-1]))
    _legend(figure, log)


@figure(
    title="Enlarged: over the surface",
    caption="Pitch around each surface interval. {0.simulation}",
    when=lambda log: bool(log.intervals),
    height_in=lambda log: 1.2 + 1.75 * min(len(log.intervals), MAX_CLOSER),
)
def closer(figure: Figure, log: ReplayedLog) -> None:
    """Draw the attitude around each of the first surface intervals."""
    time_s, shown_intervals = log.track.time_s, log.intervals[:MAX_CLOSER]
    heights = [1.0] * len(shown_intervals)
    panels = stack_panels(figure, heights, xlabel="time [s]", sharex=False)
    for axes, (start_s, end_s) in zip(panels, shown_intervals, strict=True):
        margin_s = min(CLOSER_S, max(1.0, 0.5 * (end_s - start_s)))
        shade(axes, log.intervals)
        _pitch(axes, log, (start_s - margin_s, end_s + margin_s))
        axes.set_ylabel(PITCH_LABEL)
        axes.set_xlim(
            max(start_s - margin_s, float(time_s[0])), min(end_s + margin_s, float(time_s[-1]))
        )
    _legend(figure, log)


def _pitch(axes: Axes, log: ReplayedLog, interval: tuple[float, float] | None = None) -> None:
    track, replay = log.track, log.replay
    start_s, end_s = interval or (-np.inf, np.inf)
    rows = (track.time_s >= start_s) & (track.time_s <= end_s)
    reference, theta = np.degrees(track.reference_rad[rows]), np.degrees(track.theta_rad[rows])
    broken_line(axes, track.time_s[rows], reference, color=GREY, lw=1.1, ls="--")
    broken_line(axes, track.time_s[rows], theta, color=VERMILION, lw=1.2, zorder=2.2)
    if replay is not None and _has_values(replay.theta_rad):
        simulated_rows = (replay.time_s >= start_s) & (replay.time_s <= end_s)
        simulated = np.degrees(replay.theta_rad[simulated_rows])
        broken_line(axes, replay.time_s[simulated_rows], simulated, color=BLUE, lw=1.0, zorder=2.4)
    values = np.concatenate([theta, reference])
    if np.isfinite(values).any():
        low, high = float(np.nanmin(values)), float(np.nanmax(values))
        margin = max(MARGIN * (high - low), MIN_MARGIN_DEG)
        bottom, top = axes.get_ylim()
        axes.set_ylim(max(bottom, low - margin), min(top, high + margin))


def _rotor_lines(axes: Axes, time_s: Array, rows: Array, **look: Any) -> None:
    for rotor, row in enumerate(rows):
        broken_line(axes, time_s, row, color=rotor_color(rotor), lw=0.8, **look)


def _pulses(axes: Axes, log: ReplayedLog) -> None:
    _rotor_lines(axes, log.track.time_s, log.track.pwm_us)
    if log.replay is not None:
        _rotor_lines(axes, log.replay.time_s, log.replay.pwm_us, ls=":", zorder=1.9)
    rotor_legend(axes, len(log.track.pwm_us))


def _speeds(axes: Axes, log: ReplayedLog) -> None:
    _rotor_lines(axes, log.track.time_s, log.track.rpm)
    if not len(log.track.pwm_us):
        rotor_legend(axes, len(log.track.rpm))


def _torque(axes: Axes, log: ReplayedLog) -> None:
    axes.axhline(0.0, color=GREY, lw=0.8)
    track, replay = log.track, log.replay
    if _has_values(track.torque_Nm):
        broken_line(axes, track.time_s, 1e3 * track.torque_Nm, color=GREY, lw=0.8)
    if _has_values(track.disturbance_Nm):
        broken_line(axes, track.time_s, 1e3 * track.disturbance_Nm, color=VERMILION, lw=1.1)
        if replay is not None and _has_values(replay.disturbance_Nm):
            broken_line(axes, replay.time_s, 1e3 * replay.disturbance_Nm, color=BLUE, lw=1.0)


def _height(axes: Axes, log: ReplayedLog) -> None:
    broken_line(axes, log.track.time_s, log.height_m, color=BLACK, lw=0.9)


def _legend(figure: Figure, log: ReplayedLog) -> None:
    handles: list[Artist] = [legend_line(color=VERMILION, lw=1.4, label="recorded")]
    if _has_values(log.track.reference_rad):
        handles.append(legend_line(color=GREY, lw=1.2, ls="--", label="reference"))
    if log.replay is not None and _has_values(log.replay.theta_rad):
        source = "closed loop" if log.replay.driven_by == "controller" else "logged pulses"
        label = f"simulated, {'deviates from the log' if log.replay.warning else source}"
        handles.append(legend_line(color=BLUE, lw=1.4, label=label))
    if log.intervals:
        handles.append(legend_patch(facecolor=OVER, lw=0.0, label="rotor over a surface"))
    figure.legend(handles=handles, loc="outside lower center", ncols=4)


def errors_deg(track: PitchTrack, replay: Replay | None) -> tuple[Array, ...]:
    """Return pitch errors (n,) of log and simulated run from reference or median: deg."""
    target_rad = track.reference_rad
    if not np.isfinite(target_rad).any():
        target_rad = np.full(len(track), np.nanmedian(track.theta_rad))
    recorded = np.degrees(track.theta_rad - target_rad)
    if replay is None:
        return recorded, np.full(len(track), np.nan)
    theta = resample_to_log(track, replay.time_s, replay.theta_rad)
    return recorded, np.degrees(theta - target_rad)


def rms_and_peak(errors: Array) -> tuple[float, float]:
    """Return the root mean square and the value of largest size; nan without finite errors."""
    if not np.isfinite(errors).any():
        return float("nan"), float("nan")
    rms, peak = np.sqrt(np.nanmean(errors**2)), errors[np.nanargmax(np.abs(errors))]
    return float(rms), float(peak)


def _cells(errors: Array) -> tuple[str, ...]:
    # Adding 0 removes the sign of a zero.
    return tuple(format_number(round(value, 2) + 0.0, ".2f") for value in rms_and_peak(errors))


def visits_table(log: ReplayedLog) -> Table | None:
    """Return a table of pitch errors per surface interval and outside."""
    track = log.track
    if not track.visits:
        return None
    errors = errors_deg(log.track, log.replay)
    if log.replay is None or log.replay.warning:
        errors = errors[:1]
    inside = [
        (f"{start_s:.2f} … {end_s:.2f}", log.rotors(first, last), np.arange(first, last + 1))
        for (start_s, end_s), (first, last) in zip(log.intervals, track.visits, strict=True)
    ]
    outside = ("outside", "none", np.flatnonzero(track.max_coverage <= 0.0))
    rows = [
        (span, rotors, *(cell for error in errors for cell in _cells(error[part])))
        for span, rotors, part in (*inside, outside)
    ]
    baseline = "reference" if np.isfinite(track.reference_rad).any() else "median of the log"
    heads = (
        *("time [s]", "rotors over surface", "RMS", "largest"),
        *("simulated RMS", "simulated largest"),
    )
    return Table(
        f"Pitch minus {baseline}, in degrees, positive nose down.",
        heads[: 2 + 2 * len(errors)],
        rows,
        text_columns=2,
    )


def _sentence(log: ReplayedLog) -> str:
    track, replay = log.track, log.replay
    recorded, simulated = errors_deg(log.track, log.replay)
    inside, scope = track.max_coverage > 0.0, ""
    (rms, _), (simulated_rms, _) = rms_and_peak(recorded), rms_and_peak(simulated)
    duration_s = len(track) / track.rate_Hz
    text = f"{log.recorded.name}: {duration_s:.4g} s of pitch, RMS error {rms:.2f}°"
    if inside.any():
        (rms, peak), (simulated_rms, _) = map(rms_and_peak, (recorded[inside], simulated[inside]))
        scope = " over the surface"
        text += (
            f"; over a surface in {pluralize(len(track.visits), 'interval')} "
            f"({inside.sum() / track.rate_Hz:.4g} s): RMS {rms:.2f}°, maximum "
            f"{format_number(peak, '+.2f')}°"
        )
    if replay is not None and replay.warning:
        text += f". The run simulated with {replay.model} deviates from the log and is not valid"
    elif replay is not None and np.isfinite(simulated).any():
        text += f". Simulated with {replay.model}: {simulated_rms:.2f}°{scope}"
    return text + "."


def _highlights(log: ReplayedLog) -> dict[str, str]:
    replay = log.replay
    recorded, simulated = errors_deg(log.track, log.replay)
    inside = log.track.max_coverage > 0.0
    part, scope = (inside, ", over a surface") if inside.any() else (~inside, "")
    errors = {f"RMS pitch error{scope}": recorded[part]}
    if inside.any():
        errors["elsewhere"] = recorded[~inside]
    if replay is not None and not replay.warning:
        errors[f"simulated RMS error{scope}"] = simulated[part]
        if replay.driven_by == "pulses":
            errors["recorded − simulated, RMS"] = recorded - simulated
    tiles = {name: f"{rms_and_peak(values)[0]:.2f}°" for name, values in errors.items()}
    if replay is not None and replay.warning:
        tiles["simulated run"] = "deviates from the log"
    return tiles


NO_BUDGET = (
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
    title=lambda log: (
        f"{'Pitch recording' if log.recorded.is_run else 'Replayed log'}: {log.recorded.name}"
    ),
    summary=_sentence,
    highlights=_highlights,
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
