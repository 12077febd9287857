"""A pitch or flight log as the paper's figures 26 to 30, the simulated run beside it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from benchtool.core.array_type import Array
from benchtool.core.schedule import PARKED_M
from benchtool.explain.pitch.replay import Replay, ReplayInputs
from benchtool.explain.pitch.replay_track import PitchTrack
from benchtool.report.figure import figure
from benchtool.report.palette import BLACK, BLUE, GREY, VERMILION
from benchtool.report.panels import OVER, broken_line, rotor_color, rotor_legend, rows_of, shade
from benchtool.report.replay.replay_source import ReplaySource

CLOSER_S = 5.0  # how much before and after a green stretch a closer look shows
ROOM = 0.75
LEAST_ROOM_DEG = 1.0  # least room above and below what was recorded
MOST_CLOSER = 6  # green stretches that are looked at closer; the first ones


@dataclass(frozen=True, slots=True, eq=False)
class ReplayedLog:
    """Hold a recording on an even clock, and the simulated run beside it."""

    recorded: ReplaySource
    track: PitchTrack
    beside: ReplayInputs
    replay: Replay | None = None
    warnings: Sequence[str] = ()

    @property
    def simulated(self) -> bool:
        return self.recorded.recording.simulated

    @property
    def simulation(self) -> str:
        """Which simulated run stands beside the log, in a sentence."""
        replay = self.replay
        if replay is not None:
            follows = " It does not follow the log." if replay.missed else ""
            return (
                f"Simulated beside it: model {replay.model} on rig {replay.rig}; {replay.words}."
                f"{follows}"
            )
        if self.beside.model:
            return "No simulated run stands beside it; the warnings say what it lacks."
        return "No model was named, so no simulated run stands beside it (--model)."

    @property
    def height_m(self) -> Array:
        """What a distance sensor read, or else where the plate is (n,); nan where parked."""
        sensor, plate = self.track.distance_m, self.track.plate_z_m
        near = plate < PARKED_M
        if np.isfinite(sensor).any() or not near.any():
            return sensor
        return np.where(near, plate, np.nan)

    @property
    def stretches(self) -> list[tuple[float, float]]:
        """Begin and end of every stretch with a rotor over a surface: s."""
        time_s = self.track.time_s
        return [(float(time_s[first]), float(time_s[last])) for first, last in self.track.visits]

    def rotors(self, first: int, last: int) -> str:
        """Return the numbers of the rotors that are over a surface in these rows."""
        numbers = self.track.rotors_over(first, last)
        if len(numbers) == len(self.track.over) > 1:
            return "all"
        return ", ".join(map(str, numbers))


def _known(values: Array) -> bool:
    return bool(values.size and np.isfinite(values).any())


Panel = Callable[[Axes, ReplayedLog], None]


def _panels(log: ReplayedLog) -> list[Panel]:
    """Return what is drawn below one another: what is known."""
    track = log.track
    torque = _known(track.torque_Nm) or _known(track.disturbance_Nm)
    found: list[tuple[bool, Panel]] = [
        (True, _pitch),
        (_known(track.pwm_us), _pulses),
        (_known(track.rpm), _speeds),
        (torque, _torque),
        (_known(log.height_m), _height),
    ]
    return [panel for known, panel in found if known]


@figure(
    title="The log: {0.recorded.name}",
    caption="Pitch against its reference, and what else the log holds; green: a rotor is over a "
    "surface, as in the paper's figures 26 to 30. {0.simulation}",
    height_in=lambda log: 2.2 + 1.25 * len(_panels(log)),
)
def log(figure: Figure, log: ReplayedLog) -> None:
    """Draw the whole log: attitude on top, and below what is known of outputs and torque."""
    draw, time_s = _panels(log), log.track.time_s
    panels = rows_of(figure, [2.0] + [1.0] * (len(draw) - 1))
    for axes, panel in zip(panels, draw, strict=True):
        shade(axes, log.stretches)
        panel(axes, log)
    panels[-1].set_xlabel("time [s]")
    panels[0].set_xlim(float(time_s[0]), float(time_s[-1]))
    figure.align_ylabels(panels)
    _legend(figure, log)


@figure(
    title="Closer, over the surface",
    caption="The same around each green stretch. {0.simulation}",
    when=lambda log: bool(log.stretches),
    height_in=lambda log: 1.2 + 1.75 * min(len(log.stretches), MOST_CLOSER),
)
def closer(figure: Figure, log: ReplayedLog) -> None:
    """Draw the attitude around each of the first green stretches."""
    time_s, shown = log.track.time_s, log.stretches[:MOST_CLOSER]
    panels = rows_of(figure, [1.0] * len(shown), sharex=False)
    for axes, (begin, end) in zip(panels, shown, strict=True):
        room = min(CLOSER_S, max(1.0, 0.5 * (end - begin)))
        shade(axes, log.stretches)
        _pitch(axes, log, (begin - room, end + room))
        axes.set_xlim(max(begin - room, float(time_s[0])), min(end + room, float(time_s[-1])))
    panels[-1].set_xlabel("time [s]")
    _legend(figure, log)


def _pitch(axes: Axes, log: ReplayedLog, between: tuple[float, float] | None = None) -> None:
    track, replay = log.track, log.replay
    begin, end = between or (-np.inf, np.inf)
    rows = (track.time_s >= begin) & (track.time_s <= end)
    reference, theta = np.degrees(track.reference_rad[rows]), np.degrees(track.theta_rad[rows])
    broken_line(axes, track.time_s[rows], reference, color=GREY, lw=1.1, ls="--")
    broken_line(axes, track.time_s[rows], theta, color=VERMILION, lw=1.2, zorder=2.2)
    if replay is not None and _known(replay.theta_rad):
        own = (replay.time_s >= begin) & (replay.time_s <= end)
        simulated = np.degrees(replay.theta_rad[own])
        broken_line(axes, replay.time_s[own], simulated, color=BLUE, lw=1.0, zorder=2.4)
    axes.set_ylabel("pitch [deg]\n(nose down +)")
    seen = np.concatenate([theta, reference])
    if np.isfinite(seen).any():
        low, high = float(np.nanmin(seen)), float(np.nanmax(seen))
        room = max(ROOM * (high - low), LEAST_ROOM_DEG)
        bottom, top = axes.get_ylim()
        axes.set_ylim(max(bottom, low - room), min(top, high + room))


def _pulses(axes: Axes, log: ReplayedLog) -> None:
    for rotor, row in enumerate(log.track.pwm_us):
        broken_line(axes, log.track.time_s, row, color=rotor_color(rotor), lw=0.8)
    if log.replay is not None:
        for rotor, row in enumerate(log.replay.pwm_us):
            look = {"color": rotor_color(rotor), "lw": 0.8, "ls": ":", "zorder": 1.9}
            broken_line(axes, log.replay.time_s, row, **look)
    axes.set_ylabel("outputs\n[µs]")
    rotor_legend(axes, len(log.track.pwm_us))


def _speeds(axes: Axes, log: ReplayedLog) -> None:
    for rotor, row in enumerate(log.track.rpm):
        broken_line(axes, log.track.time_s, row, color=rotor_color(rotor), lw=0.8)
    axes.set_ylabel("speeds\n[rpm]")
    if not len(log.track.pwm_us):
        rotor_legend(axes, len(log.track.rpm))


def _torque(axes: Axes, log: ReplayedLog) -> None:
    axes.axhline(0.0, color=GREY, lw=0.8)
    track, replay = log.track, log.replay
    if _known(track.torque_Nm):
        broken_line(axes, track.time_s, 1e3 * track.torque_Nm, color=GREY, lw=0.8)
    if _known(track.disturbance_Nm):
        broken_line(axes, track.time_s, 1e3 * track.disturbance_Nm, color=VERMILION, lw=1.1)
        if replay is not None and _known(replay.disturbance_Nm):
            broken_line(axes, replay.time_s, 1e3 * replay.disturbance_Nm, color=BLUE, lw=1.0)
    axes.set_ylabel("torque\n[mN m]")


def _height(axes: Axes, log: ReplayedLog) -> None:
    broken_line(axes, log.track.time_s, log.height_m, color=BLACK, lw=0.9)
    axes.set_ylabel("surface\nbelow [m]")


def _legend(figure: Figure, log: ReplayedLog) -> None:
    handles: list[Patch | Line2D] = [Line2D([], [], color=VERMILION, lw=1.4, label="recorded")]
    if _known(log.track.reference_rad):
        handles.append(Line2D([], [], color=GREY, lw=1.2, ls="--", label="wanted"))
    if log.replay is not None and _known(log.replay.theta_rad):
        how = "closed loop" if log.replay.by == "controller" else "logged pulses"
        label = f"simulated, {'does not follow the log' if log.replay.missed else how}"
        handles.append(Line2D([], [], color=BLUE, lw=1.4, label=label))
    if log.stretches:
        handles.append(Patch(facecolor=OVER, lw=0.0, label="a rotor is over a surface"))
    figure.legend(handles=handles, loc="outside lower center", ncols=4)
