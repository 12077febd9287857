"""A pitch or flight log as the paper's figures 26 to 30, the simulated run beside it.

Green where a rotor is over a surface; attitude against reference; outputs, speeds, torque and
distance where they are known.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from benchtool.core.errors import InputError
from benchtool.report.fit.lengths import refuse_unequal
from benchtool.report.flight.envelope import envelope
from benchtool.report.flight.pitch import OVER
from benchtool.report.palette import BLACK, BLUE, CYCLE, GREY, VERMILION
from benchtool.report.style import new_figure, styled
from benchtool.report.sweep.sweep import rotor_legend

Array = NDArray[np.float64]

Span = tuple[float, float]

CLOSER_S = 5.0
"""How much before and after a green stretch a closer look shows."""

ROOM = 0.75
LEAST_ROOM_DEG = 1.0
"""Room above and below what was recorded, as a share of its range and at least so much: a simulated
run that leaves it must not squeeze the recording flat."""

MOST_CLOSER = 6
"""Green stretches that are looked at closer; the first ones."""


def _none() -> Array:
    return np.empty(0)


def _no_rows() -> Array:
    return np.empty((0, 0))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ReplayTrace:
    """Hold a recording with its simulated run for drawing; nan where lines break.

    Attributes:
        time_s, pitch_deg, reference_deg: (n,); the reference is nan where none was logged.
        over: begin and end of each stretch with a rotor over a surface, with a few words of it.
        pwm_us, rpm: (n_rotors, n); empty without.
        torque_mNm, disturbance_mNm: (n,) of the controller; nan without.
        height_m: (n,) what a distance sensor read, or where the plate is; nan without.
        sim_time_s, sim_pitch_deg: (m,) of the simulated run; empty without.
        sim_pwm_us: (n_rotors, m); empty where logged pulses drove it.
        sim_disturbance_mNm: (m,) what the simulated observer sees; empty without.
        sim_label: legend entry.
    """

    time_s: Array
    pitch_deg: Array
    reference_deg: Array
    over: Sequence[tuple[Span, str]] = ()
    pwm_us: Array = field(default_factory=_no_rows)
    rpm: Array = field(default_factory=_no_rows)
    torque_mNm: Array = field(default_factory=_none)
    disturbance_mNm: Array = field(default_factory=_none)
    height_m: Array = field(default_factory=_none)
    sim_time_s: Array = field(default_factory=_none)
    sim_pitch_deg: Array = field(default_factory=_none)
    sim_pwm_us: Array = field(default_factory=_no_rows)
    sim_disturbance_mNm: Array = field(default_factory=_none)
    sim_label: str = "simulated"

    def __post_init__(self) -> None:
        refuse_unequal(
            "a replayed log",
            time_s=self.time_s,
            pitch_deg=self.pitch_deg,
            reference_deg=self.reference_deg,
        )
        refuse_unequal(
            "its simulated run", sim_time_s=self.sim_time_s, sim_pitch_deg=self.sim_pitch_deg
        )


def _known(values: Array) -> bool:
    return bool(values.size and np.isfinite(values).any())


@styled
def replay_figure(trace: ReplayTrace, *, title: str, simulated: bool) -> Figure:
    """Draw the whole log: attitude on top, and below what is known of outputs and torque."""
    draw: list[Callable[[Axes, ReplayTrace], None]] = [_pitch]
    for known, one in (
        (_known(trace.pwm_us), _pulses),
        (_known(trace.rpm), _speeds),
        (_known(trace.torque_mNm) or _known(trace.disturbance_mNm), _torque),
        (_known(trace.height_m), _height),
    ):
        if known:
            draw.append(one)
    figure = new_figure(title, simulated=simulated, height_in=2.2 + 1.25 * len(draw))
    panels = figure.subplots(
        len(draw), 1, sharex=True, squeeze=False,
        gridspec_kw={"height_ratios": [2.0] + [1.0] * (len(draw) - 1)},
    )[:, 0]  # fmt: skip
    for axes, panel in zip(panels, draw, strict=True):
        _shade(axes, trace)
        panel(axes, trace)
    panels[-1].set_xlabel("time [s]")
    panels[0].set_xlim(float(trace.time_s[0]), float(trace.time_s[-1]))
    figure.align_ylabels(list(panels))
    _legend(figure, trace)
    return figure


@styled
def closer_figure(trace: ReplayTrace, *, title: str, simulated: bool) -> Figure:
    """Draw the attitude around each green stretch."""
    shown = [span for span, _ in trace.over][:MOST_CLOSER]
    if not shown:
        raise InputError("no rotor is over a surface, so there is no stretch to look at closer")
    figure = new_figure(title, simulated=simulated, height_in=1.2 + 1.75 * len(shown))
    panels = figure.subplots(len(shown), 1, squeeze=False)[:, 0]
    for axes, (begin, end) in zip(panels, shown, strict=True):
        room = min(CLOSER_S, max(1.0, 0.5 * (end - begin)))
        first, last = begin - room, end + room
        _shade(axes, trace)
        _pitch(axes, trace, (first, last))
        axes.set_xlim(max(first, float(trace.time_s[0])), min(last, float(trace.time_s[-1])))
    panels[-1].set_xlabel("time [s]")
    _legend(figure, trace)
    return figure


def _shade(axes: Axes, trace: ReplayTrace) -> None:
    for (begin, end), _ in trace.over:
        axes.axvspan(begin, end, color=OVER, linewidth=0.0, zorder=0.4, gid="over-surface")


def _line(axes: Axes, time_s: Array, values: Array, **look: object) -> None:
    """Draw a signal thinned for drawing, broken where it is blank."""
    known = np.isfinite(values)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], known.astype(np.int8), [0]])))
    slots = max(40, int(900 / max(len(edges) // 2, 1)))
    at, shown = [np.empty(0)], [np.empty(0)]
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        thin = envelope(time_s[begin:end], values[begin:end], slots)
        at += [thin[0], np.array([np.nan])]
        shown += [thin[1], np.array([np.nan])]
    axes.plot(np.concatenate(at), np.concatenate(shown), **look)  # type: ignore[arg-type]


def _pitch(axes: Axes, trace: ReplayTrace, between: Span | None = None) -> None:
    rows = np.ones(len(trace.time_s), bool)
    own = np.ones(len(trace.sim_time_s), bool)
    if between is not None:
        rows = (trace.time_s >= between[0]) & (trace.time_s <= between[1])
        own = (trace.sim_time_s >= between[0]) & (trace.sim_time_s <= between[1])
    _line(axes, trace.time_s[rows], trace.reference_deg[rows], color=GREY, lw=1.1, ls="--")
    _line(axes, trace.time_s[rows], trace.pitch_deg[rows], color=VERMILION, lw=1.2, zorder=2.2)
    if _known(trace.sim_pitch_deg):
        _line(axes, trace.sim_time_s[own], trace.sim_pitch_deg[own], color=BLUE, lw=1.0, zorder=2.4)
    axes.set_ylabel("pitch [deg]\n(nose down +)")
    seen = np.concatenate([trace.pitch_deg[rows], trace.reference_deg[rows]])
    if np.isfinite(seen).any():
        low, high = float(np.nanmin(seen)), float(np.nanmax(seen))
        room = max(ROOM * (high - low), LEAST_ROOM_DEG)
        drawn = axes.get_ylim()
        axes.set_ylim(max(drawn[0], low - room), min(drawn[1], high + room))


def _pulses(axes: Axes, trace: ReplayTrace) -> None:
    for rotor, row in enumerate(trace.pwm_us):
        _line(axes, trace.time_s, row, color=CYCLE[rotor % len(CYCLE)], lw=0.8)
    for rotor, row in enumerate(trace.sim_pwm_us):
        color = CYCLE[rotor % len(CYCLE)]
        _line(axes, trace.sim_time_s, row, color=color, lw=0.8, ls=":", zorder=1.9)
    axes.set_ylabel("outputs\n[µs]")
    rotor_legend(axes, len(trace.pwm_us))


def _speeds(axes: Axes, trace: ReplayTrace) -> None:
    for rotor, row in enumerate(trace.rpm):
        _line(axes, trace.time_s, row, color=CYCLE[rotor % len(CYCLE)], lw=0.8)
    axes.set_ylabel("speeds\n[rpm]")
    if not len(trace.pwm_us):
        rotor_legend(axes, len(trace.rpm))


def _torque(axes: Axes, trace: ReplayTrace) -> None:
    axes.axhline(0.0, color=GREY, lw=0.8)
    if _known(trace.torque_mNm):
        _line(axes, trace.time_s, trace.torque_mNm, color=GREY, lw=0.8)
    if _known(trace.disturbance_mNm):
        _line(axes, trace.time_s, trace.disturbance_mNm, color=VERMILION, lw=1.1)
    if _known(trace.sim_disturbance_mNm):
        _line(axes, trace.sim_time_s, trace.sim_disturbance_mNm, color=BLUE, lw=1.0)
    axes.set_ylabel("torque\n[mN m]")


def _height(axes: Axes, trace: ReplayTrace) -> None:
    _line(axes, trace.time_s, trace.height_m, color=BLACK, lw=0.9)
    axes.set_ylabel("surface\nbelow [m]")


def _legend(figure: Figure, trace: ReplayTrace) -> None:
    handles: list[Patch | Line2D] = [Line2D([], [], color=VERMILION, lw=1.4, label="recorded")]
    if _known(trace.reference_deg):
        handles.append(Line2D([], [], color=GREY, lw=1.2, ls="--", label="wanted"))
    if _known(trace.sim_pitch_deg):
        handles.append(Line2D([], [], color=BLUE, lw=1.4, label=trace.sim_label))
    if trace.over:
        handles.append(Patch(facecolor=OVER, lw=0.0, label="a rotor is over a surface"))
    figure.legend(handles=handles, loc="outside lower center", ncols=4)
