"""A simulation as a page shows it at once: side views that move, curves, the numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from benchtool.core.array import Array
from benchtool.report.side_view import Scene

Role = Literal["shown", "away", "wanted", "goal"]
"""What a curve is: the run, the same out of ground effect, the reference, where it should
end."""

FRAMES = 800
"""Most frames of a run that are shown: 20 per second for 40 s. A choice."""

QUICK_FRAMES = 300
"""The same in a quick preview: one for each dot of a chart that stands beside two others on a usual
screen. A choice."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DrawnMotion:
    """Hold how a side view moves.

    Attributes:
        along_m, up_m: (m,) place of the vehicle's centre, along its way and up.
        pitch_deg: (m,) nose down.
        own: (n_rotors, m) thrust of each rotor without anything below, over that of hover.
        added: (n_rotors, m) what the surface adds.
        shift_m: (n_moving, m) how far each moving surface is out of its place.
    """

    time_s: Array
    along_m: Array
    up_m: Array
    pitch_deg: Array
    own: Array
    added: Array
    shift_m: Array


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ChartLine:
    """Hold one line of a chart: values (m,) at times (m,)."""

    role: Role
    time_s: Array
    values: Array


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ControllerRun:
    """Hold the run of one controller.

    Attributes:
        charts: lines of each chart below it, by what its axis counts.
        over: begin and end of each stretch in which a rotor is over a surface, in s.
    """

    label: str
    outcome: str
    scene: Scene
    motion: DrawnMotion
    charts: dict[str, tuple[ChartLine, ...]]
    over: tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SimulationPreview:
    """Hold what a page shows of a simulation.

    Attributes:
        lines: the table of numbers, as the command prints it; empty in a quick preview.
        warnings: what a reader of the numbers must know; empty in a quick preview.
    """

    runs: tuple[ControllerRun, ...]
    lines: tuple[str, ...]
    warnings: tuple[str, ...]


def frames(rows: int, quick: bool) -> slice:
    """Return which rows of a log are shown."""
    return slice(0, rows, max(1, -(-rows // (QUICK_FRAMES if quick else FRAMES))))
