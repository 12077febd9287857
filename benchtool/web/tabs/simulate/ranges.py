"""The numbers that the Simulate tab offers to change, with their ranges. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from math import floor, log10

from benchtool.core.schedule_file import schedule_named
from benchtool.physics.catalogue import candidates
from benchtool.physics.tolerances import default_tolerances
from benchtool.report.numbers import unit_for_people
from benchtool.simulate.flight.cases import FLIGHTS
from benchtool.simulate.pitch.setup import PLATE_DISTANCE, pitch_setup

K_B = "body_lift.K_b"

MOST = 12.0
"""Tolerances that the slider of a hidden effect reaches; a choice."""

FIRST = 6.0
"""Tolerances at which it stands at first: enough to show, a choice."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Slider:
    """Describe one slider.

    Attributes:
        name: as `--set` takes it, or an option's own name.
        label: for people, with the unit.
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
    sliders = [
        Slider(name=K_B, label="Body lift K_b [–]", low=0.0, high=6.0, step=0.1, start=K_b),
        Slider(
            name="gains.attitude", label="Attitude gains, times", low=0.3, high=3.0, step=0.05,
            start=1.0,
        ),
        Slider(
            name="gains.observer", label="Observer's rate, times", low=0.1, high=3.0, step=0.05,
            start=1.0,
        ),
    ]  # fmt: skip
    distances = {visit.z_over_R for visit in schedule_named(schedule).plate}
    if len(distances) == 1:
        plate = Slider(
            name=PLATE_DISTANCE, label="Plate distance z/R [–]", low=0.6, high=5.0, step=0.05,
            start=distances.pop(),
        )  # fmt: skip
        sliders.insert(0, plate)
    return tuple(sliders)


def flight_sliders(case: str) -> tuple[Slider, ...]:
    """Return the numbers that the page offers for a shipped flight."""
    shipped = FLIGHTS[case]
    return (
        Slider(
            name="z_over_R", label="Height z/R [–]", low=0.8, high=6.0, step=0.05,
            start=shipped.z_over_R,
        ),
        Slider(
            name="speed_m_s", label="Speed limit [m/s]", low=0.1, high=2.0, step=0.05,
            start=shipped.speed_m_s,
        ),
        Slider(name="K_b", label="Body lift K_b [–]", low=0.0, high=6.0, step=0.1, start=2.0),
        Slider(
            name="gains.attitude", label="Attitude gains, times", low=0.5, high=2.0, step=0.05,
            start=1.0,
        ),
        Slider(
            name="gains.position", label="Position gains, times", low=0.5, high=2.0, step=0.05,
            start=1.0,
        ),
        Slider(
            name="gains.observer", label="Observer's rate, times", low=0.1, high=3.0, step=0.05,
            start=1.0,
        ),
    )  # fmt: skip


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
    step = _round_step(tolerance)
    toward = tolerance if start + MOST * tolerance <= item.upper else -tolerance
    far = start + MOST * toward
    low, high = max(min(start, far), item.lower), min(max(start, far), item.upper)
    return Slider(
        name=name,
        label=f"{found.title} [{unit_for_people(item.unit)}]",
        low=low,
        high=high,
        step=step,
        start=start,
        first=start + FIRST * toward,
    )


def _round_step(tolerance: float) -> float:
    """Return a round number near a fifth of a tolerance."""
    rough = tolerance / 5.0
    power = floor(log10(rough))
    part = max(mark for mark in (1, 2, 5) if mark <= rough / 10.0**power * (1.0 + 1e-9))
    return float(f"{part}e{power}")
