"""The flights of the paper's figures 12 to 15, 17, 18, 20 to 24 and 30, as simulated."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from matplotlib.figure import Figure

from benchtool.core.rig import Rig
from benchtool.fit.run_recipe import FitOutput
from benchtool.physics.wake_picture import Hover
from benchtool.report.figure import Page, drawn, figure
from benchtool.report.flight.flight import draw_flights, flights_width
from benchtool.report.flight.pitch_study import (
    PitchTrace,
    draw_pitch,
    draw_study,
    pitch_height,
    pitch_study,
    trace_of,
)
from benchtool.report.page import FigureBlock
from benchtool.simulate.controllers.laws import FLIGHT_CONTROLLERS
from benchtool.simulate.flight.cases import GYRO_NOISE_RAD_S, OBSTACLE_X_M
from benchtool.simulate.flight.study import Flown
from benchtool.simulate.pitch.setup import PitchSetup, changed, pitch_setup

STICTION = (
    "Steps and flat lines: dry friction in the hinge, 1/5 of the plate's moment, holds the\n"
    "vehicle still; the wakes' random torque, 1/20, does not move it alone."
)

UNTIL_S = 60.0
"""What is drawn of the flights: afterwards nothing new happens."""

FOCUS_M = {"over": None, "edge": (2.1, 3.5)}
"""Limits of the position axis."""

CASES = {"over": "flying over the obstacle", "edge": "hovering at its edge"}

OFF = "out of ground effect"


class Flies(Protocol):
    """Fly shipped cases, each once."""

    @property
    def rig(self) -> Rig:
        """What flies."""
        ...

    @property
    def fits(self) -> Mapping[str, FitOutput]:
        """Fits of the user's own recipes: single, second, three, quad; whose points are drawn."""
        ...

    def fly(
        self, name: str, control: str = "pid", z_over_R: float | None = 2.0, **changes: Any
    ) -> Flown:
        """Return a flight of a shipped case."""
        ...


Columns = Callable[[Flies], dict[str, Flown]]


def _register(
    name: str,
    title: str | Callable[[Flies], str],
    caption: str,
    columns: Columns,
    count: int,
    case: str = "over",
    with_free: bool = False,
    **look: Any,
) -> None:
    """Register a figure of flights side by side, in grey PID out of ground effect."""
    options: dict[str, Any] = {"until_s": UNTIL_S, "obstacle_m": OBSTACLE_X_M}
    options |= {"focus_m": FOCUS_M.get(case), **look}

    def draw(figure: Figure, flights: Flies) -> None:
        free = (f"PID, {OFF}", flights.fly(case, "pid", None)) if with_free else None
        draw_flights(figure, columns(flights), beside=free, **options)

    figure(
        page="paper", name=name, title=title, caption=caption, simulated=True, height_in=5.3,
        width_in=flights_width(count),
    )(draw)  # fmt: skip


def _heights(case: str, control: str) -> Columns:
    heights = {OFF: None, "z/R = 3": 3.0, "z/R = 2": 2.0}
    return lambda flights: {
        name: flights.fly(case, control, z_over_R) for name, z_over_R in heights.items()
    }


def _controllers(case: str) -> Columns:
    names = ("pid", "observer", "feedforward")
    return lambda flights: {FLIGHT_CONTROLLERS[name]: flights.fly(case, name) for name in names}


FLIGHTS = (
    *((12, "pid", "over"), (13, "pid", "edge")),
    *((17, "observer", "over"), (18, "observer", "edge")),
    *((20, "feedforward", "over"), (21, "feedforward", "edge")),
)
"""Number of each figure with one controller at several heights, its controller and its case."""

for _number, _control, _case in FLIGHTS:
    _register(
        f"fig{_number}-{_control}-{_case}",
        f"{FLIGHT_CONTROLLERS[_control]}: {CASES[_case]}, 0.2 m/s (Fig. {_number})",
        "The same flight far from the obstacle, and at two heights over it.",
        _heights(_case, _control),
        3,
        _case,
        with_free=_control != "pid",
    )

_register(
    "fig14-pid-1-m-s",
    "PID at 1 m/s, z/R = 2 (Fig. 14)",
    "Five times as fast: both cases under PID.",
    lambda flights: {
        "(a) hovering at the edge": flights.fly("edge", speed_m_s=1.0),
        "(b) flying over the obstacle": flights.fly("over", speed_m_s=1.0),
    },
    2,
    until_s=30.0,
)

_register(
    "fig15-pid-noise",
    "PID with gyro noise of 0.015 rad/s, 1 m/s, z/R = 2: no wider than without (Fig. 15)",
    "The oscillation at the edge does not come from the sensors' noise.",
    lambda flights: {
        "without noise": flights.fly("edge", speed_m_s=1.0),
        "with noise": flights.fly("edge", speed_m_s=1.0, gyro_noise_rad_s=GYRO_NOISE_RAD_S),
    },
    2,
    "edge",
)

_register(
    "fig22-map-errors",
    "Feedforward with a map that has the edge too early, z/R = 2 (Fig. 22)",
    "How far a map may be off before feedforward does harm.",
    lambda flights: {
        "true map": flights.fly("edge", "feedforward"),
        "(a) 5 cm early": flights.fly("edge", "feedforward", map_offset_m=(-0.05, 0.0, 0.0)),
        "(b) 15 cm early": flights.fly("edge", "feedforward", map_offset_m=(-0.15, 0.0, 0.0)),
    },
    3,
    "edge",
)

for _number, _case in ((23, "over"), (24, "edge")):
    _register(
        f"fig{_number}-comparison-{_case}",
        f"Controllers compared: {CASES[_case]}, z/R = 2 (Fig. {_number})",
        "The same flight under each controller.",
        _controllers(_case),
        3,
        _case,
        with_free=True,
    )

EXTRA = ("oblique", "corner", "gust", "ramp")
"""Cases that the paper's planar picture leaves out."""


def _extra_title(case: str) -> Callable[[Flies], str]:
    return lambda flights: f"{flights.fly(case).case.title}, z/R = 2"


for _case in EXTRA:
    _register(
        f"extra-{_case}",
        _extra_title(_case),
        "A case that the paper does not have, under each controller.",
        _controllers(_case),
        3,
        _case,
        obstacle_m=None,
    )


@figure(
    page="paper",
    name="fig30-plate-in-flight",
    title="A plate under one rotor: free and hinged (Fig. 30)",
    caption=(
        "A plate comes under the front rotor, in free hover and on the hinge. Dashed is the pitch "
        "that is wanted: in free hover the velocity loop's command, on the hinge zero."
    ),
    simulated=True,
    height_in=pitch_height(4),
)
def plate_in_flight(figure: Figure, flights: Flies) -> None:
    """Draw figure 30: a plate under the front rotor, in free hover and on the hinge."""
    traces = []
    for control, label in (("pid", "PID"), ("observer", "PID + observer")):
        hover = flights.fly("plate", control).flight
        traces.append(
            PitchTrace(
                f"free hover, {label}: the vehicle may drift",
                hover["time_s"],
                np.degrees(hover["pitch_rad"]),
                np.degrees(hover["pitch_ref_rad"]),
                (hover["coverage1"] > 1e-3).astype(float),
            )
        )
    hinged = pitch_setup(gains="s3", controllers=("pid",))
    for setup, label in ((hinged, "PID"), (_slow(), "PID with a slow integral")):
        run = pitch_study(setup, 1).runs[0]
        traces.append(trace_of(run, f"on the hinge with its friction, {label}"))
    draw_pitch(figure, traces, STICTION)


def _slow(rig: str = "pquad") -> PitchSetup:
    """Return the bench under PID with a slow integral."""
    setup = pitch_setup(rig=rig, gains="s3", controllers=("pid",))
    return changed(setup, {"gains.attitude.k_i_theta_per_s2": 0.5})


def _bench(name: str, title: str, caption: str, controllers: Sequence[str], **setup: Any) -> None:
    def draw(figure: Figure, flights: Flies) -> None:
        rig = setup.get("slow_rig")
        made = (
            _slow(rig) if rig else pitch_setup(gains="s3", controllers=tuple(controllers), **setup)
        )
        draw_study(figure, pitch_study(made, 1), STICTION)

    figure(
        page="paper", name=name, title=title, caption=caption, simulated=True,
        height_in=pitch_height(len(controllers)),
    )(draw)  # fmt: skip


for _letter, _rig in (("a", "pquad"), ("b", "amuse")):
    _bench(
        f"fig26{_letter}-bench-{_rig}",
        f"{_rig}: plate under one rotor, PID + integral (Fig. 26{_letter})",
        "Pitch on the bench while a plate comes and goes.",
        ["pid"],
        slow_rig=_rig,
    )
_bench(
    "fig27-bench-feedforward",
    "Bench: PID without and with feedforward (Fig. 27)",
    "Feedforward removes the tilt that the plate causes.",
    ["pid", "feedforward"],
)
_bench(
    "fig27-bench-switched",
    "Bench: feedforward switched on at 20 s (Fig. 27)",
    "The same plate before and after feedforward is switched on.",
    ["feedforward"],
    schedule="switch",
)
_bench(
    "fig28-bench-observer",
    "Bench: PID without and with observer (Fig. 28)",
    "The observer removes the tilt without knowing the plate.",
    ["pid", "observer"],
)


PAPER = Page(
    "paper",
    [
        (
            "Models",
            [
                *("fig03-single-rotor", "fig04-quad-and-single", "fig06-body-lift"),
                *("fig08-three-rotors", "fig09-attitude"),
            ],
        ),
        ("Set-ups", ["fig07-partial-effect", "fig10-map", "fig11-cases", "fig29-plate-set-up"]),
        ("Controllers", ["fig16-observer-scheme", "fig19-feedforward-scheme"]),
        (
            "Flights",
            [
                *(f"fig{number}-{control}-{case}" for number, control, case in FLIGHTS),
                *("fig14-pid-1-m-s", "fig15-pid-noise", "fig22-map-errors"),
                *("fig23-comparison-over", "fig24-comparison-edge", "fig30-plate-in-flight"),
                *(f"extra-{case}" for case in EXTRA),
            ],
        ),
        (
            "The pitch bench",
            [
                *("fig26a-bench-pquad", "fig26b-bench-amuse", "fig27-bench-feedforward"),
                *("fig27-bench-switched", "fig28-bench-observer"),
            ],
        ),
    ],
)


def paper_figures(flights: Flies) -> Iterator[tuple[str, FigureBlock]]:
    """Give every figure with its file name, one after the other."""
    yield from drawn("paper.flow", Hover.quad()).items()
    for name in PAPER.figures:
        yield from drawn("paper", flights, [name]).items()
