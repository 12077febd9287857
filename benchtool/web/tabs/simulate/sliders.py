"""The numbers that the Simulate tab offers to change, as sliders with their value beside them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from math import floor, log10

from nicegui import ui

from benchtool.core.schedule_file import schedule_named
from benchtool.physics.catalogue import candidates
from benchtool.physics.effects.body_lift import EFFECT as BODY_LIFT
from benchtool.physics.tolerances import default_tolerances
from benchtool.report.numbers import unit_for_people
from benchtool.simulate.flight.cases import FLIGHTS
from benchtool.simulate.pitch.setup import PLATE_DISTANCE, pitch_setup
from benchtool.web.widgets import LocalSlider

K_B = f"{BODY_LIFT.name}.{BODY_LIFT.headline}"

MOST = 12.0
"""Tolerances that the slider of a hidden effect reaches; a choice."""

FIRST = 6.0
"""Tolerances at which it stands at first: enough to show, a choice."""


@dataclass(frozen=True, slots=True)
class Slider:
    """Describe one slider.

    Attributes:
        name: as `--set` takes it, or an option's own name.
        low, high, step: what can be chosen; choices of the page, the command takes more.
        start: the simulation's own value; a number that stands there is not in the command.
        first: where the slider stands when it is first shown; at `start` when None.
    """

    name: str
    label: str
    low: float
    high: float
    step: float
    start: float
    first: float | None = None

    @property
    def decimals(self) -> int:
        """How many digits behind the point a value is shown with."""
        text = f"{self.step:.10f}".rstrip("0")
        return len(text.partition(".")[2])


def pitch_sliders(rig: str, schedule: str) -> tuple[Slider, ...]:
    """Return the numbers that the page offers for a rig and a schedule."""
    model = pitch_setup(rig=rig, controllers=("pid",)).bench.model
    K_b = model.parameters[K_B].value if K_B in model.parameters else 0.0
    distances = {visit.z_over_R for visit in schedule_named(schedule).plate}
    plate = [
        Slider(PLATE_DISTANCE, "Plate distance z/R [–]", 0.6, 5.0, 0.05, distance)
        for distance in distances
    ]
    return (
        *(plate if len(plate) == 1 else ()),
        Slider(K_B, "Body lift K_b [–]", 0.0, 6.0, 0.1, K_b),
        Slider("gains.attitude", "Attitude gains, times", 0.3, 3.0, 0.05, 1.0),
        Slider("gains.observer", "Observer's rate, times", 0.1, 3.0, 0.05, 1.0),
    )


def flight_sliders(case: str) -> tuple[Slider, ...]:
    """Return the numbers that the page offers for a shipped flight."""
    shipped = FLIGHTS[case]
    return (
        Slider("z_over_R", "Height z/R [–]", 0.8, 6.0, 0.05, shipped.z_over_R),
        Slider("speed_m_s", "Speed limit [m/s]", 0.1, 2.0, 0.05, shipped.speed_m_s),
        Slider("K_b", "Body lift K_b [–]", 0.0, 6.0, 0.1, 2.0),
        Slider("gains.attitude", "Attitude gains, times", 0.5, 2.0, 0.05, 1.0),
        Slider("gains.position", "Position gains, times", 0.5, 2.0, 0.05, 1.0),
        Slider("gains.observer", "Observer's rate, times", 0.1, 3.0, 0.05, 1.0),
    )


def hideable() -> dict[str, str]:
    """Return the effects that a pitch bench can hide, name to title; K_b has a slider anyhow."""
    own = K_B.partition(".")[0]
    return {effect.name: effect.title for effect in candidates("pitch") if effect.name != own}


def hidden_slider(rig: str, effect: str) -> Slider:
    """Return the slider of an effect's main parameter, off the value that the rig's model has."""
    model = pitch_setup(rig=rig, controllers=("pid",)).bench.model
    found = next(each for each in candidates("pitch") if each.name == effect)
    tolerance_of = default_tolerances(found, model.rig, "pitch")
    item = next(item for item in found.parameters if item.name in tolerance_of)
    name, tolerance = f"{effect}.{item.name}", tolerance_of[item.name]
    start = model.parameters[name].value if name in model.parameters else item.neutral or 0.0
    toward = tolerance if start + MOST * tolerance <= item.upper else -tolerance
    far = start + MOST * toward
    # A round number near a fifth of a tolerance.
    rough = tolerance / 5.0
    power = floor(log10(rough))
    part = max(mark for mark in (1, 2, 5) if mark <= rough / 10.0**power * (1.0 + 1e-9))
    return Slider(
        name=name,
        label=f"{found.title} [{unit_for_people(item.unit)}]",
        low=max(min(start, far), item.lower),
        high=min(max(start, far), item.upper),
        step=float(f"{part}e{power}"),
        start=start,
        first=start + FIRST * toward,
    )


class Sliders:
    """Show sliders, and know which numbers are changed."""

    def __init__(self, changed: Callable[[], None]) -> None:
        self._changed = changed
        self._place = ui.element("div").classes("simulate-numbers w-full")
        self._sliders: dict[str, tuple[Slider, LocalSlider]] = {}

    def offer(self, sliders: Iterable[Slider]) -> None:
        """Show these; one that was there before stays where it was moved."""
        moved = self.moved
        self._place.clear()
        self._sliders = {}
        with self._place:
            for each in sliders:
                first = each.start if each.first is None else each.first
                value = moved.get(each.name, first)
                self._sliders[each.name] = (each, self._slider(each, value))

    def _slider(self, each: Slider, value: float) -> LocalSlider:
        with ui.element("div"):
            with ui.element("div").classes("simulate-number-head"):
                ui.label(each.label)
                number = ui.label(f"{value:.{each.decimals}f}").classes("number")
            slider = LocalSlider(min=each.low, max=each.high, step=each.step, value=value)
            slider.props(f'dense aria-label="{each.label}"')

        def moved() -> None:
            number.set_text(f"{slider.value:.{each.decimals}f}")
            self._changed()

        slider.on_value_change(moved)
        return slider

    @property
    def moved(self) -> dict[str, float]:
        """Numbers that are not where they were at first, by name."""
        return {
            name: round(float(slider.value), each.decimals)
            for name, (each, slider) in self._sliders.items()
            if slider.value is not None and abs(slider.value - each.start) > 0.5 * each.step
        }

    def reset(self) -> None:
        for each, slider in self._sliders.values():
            slider.set_value(each.start)
