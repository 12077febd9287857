"""What the page asks of the pitch bench: names and numbers, and the command that asks the same."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import floor, log10
from pathlib import Path
from typing import TYPE_CHECKING

from benchtool.core.errors import InputError
from benchtool.core.rig_file import rig_named
from benchtool.core.schedule_file import schedule_named
from benchtool.physics.catalogue import candidates
from benchtool.physics.tolerances import default_tolerances
from benchtool.report.numbers import unit_for_people
from benchtool.simulate.flight.cases import FLIGHTS
from benchtool.simulate.flight.flight import FlightControl
from benchtool.simulate.flight.setup import FlightSetup
from benchtool.simulate.flight.setup import changed as changed_flight
from benchtool.simulate.flight.vehicle import FlightVehicle
from benchtool.simulate.gain_file import gains_named
from benchtool.simulate.pitch.setup import PLATE_DISTANCE, PitchSetup, changed, pitch_setup

if TYPE_CHECKING:
    from benchtool.report.preview import SimulationPreview


MOST = 12.0
"""Tolerances that the slider of a hidden effect reaches; a choice."""

FIRST = 6.0
"""Tolerances at which it stands at first: enough to show, a choice."""


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


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightAsk:
    """Ask for a shipped flight.

    Attributes:
        case, rig, gains: names of what ships.
        controllers: built-in ones.
        z_over_R: height over the obstacle in rotor radii.
        speed_m_s: speed limit.
        seed: of the noise.
        numbers: changed ones, by the names of `--set`.
    """

    case: str = "over"
    rig: str = "pquad"
    gains: str = "s3"
    controllers: tuple[FlightControl, ...] = ("pid", "observer", "feedforward")
    z_over_R: float = 2.0
    speed_m_s: float = 0.2
    seed: int = 1
    numbers: dict[str, float] = field(default_factory=dict)

    @property
    def words(self) -> list[str]:
        """The same as words behind `benchtool`."""
        words = ["simulate", "flight", "--case", self.case, "--rig", self.rig]
        words += ["--gains", self.gains, "--controllers", ",".join(self.controllers)]
        words += ["--z-over-r", f"{self.z_over_R:.10g}", "--speed-m-s", f"{self.speed_m_s:.10g}"]
        return [*words, "--seed", str(self.seed), *set_words(self.numbers)]

    def setup(self) -> FlightSetup:
        """Return what is flown.

        Raises:
            InputError: a name or number that cannot be.
        """
        require_controllers(self.controllers)
        setup = FlightSetup(
            case=self.case,
            vehicle=FlightVehicle(rig=rig_named(self.rig)),
            gains=gains_named(self.gains),
            z_over_R=self.z_over_R,
            speed_m_s=self.speed_m_s,
        )
        return changed_flight(setup, self.numbers)

    def preview(self, quick: bool) -> SimulationPreview:
        """Simulate, for the page."""
        from benchtool.report.flight_preview import flight_preview

        return flight_preview(self.setup(), self.controllers, self.seed, quick=quick)

    def write(self, folder: Path) -> list[Path]:
        """Simulate, and write what the command writes with --out."""
        from benchtool.report.flight.report import fly_each, write_flights

        flights = fly_each(self.setup().flown("pid", self.seed), self.controllers)
        return write_flights(folder, flights)


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


K_B = "body_lift.K_b"


@dataclass(frozen=True, slots=True, kw_only=True)
class PitchAsk:
    """Ask for a simulation of the pitch bench.

    Attributes:
        rig, gains, schedule: names of what ships.
        controllers: built-in ones.
        duration_s: length; the schedule's own when None.
        seed: of the noise.
        numbers: changed ones, by the names of `--set`.
    """

    rig: str = "pquad"
    gains: str = "s3"
    schedule: str = "plate"
    controllers: tuple[str, ...] = ("pid", "feedforward", "observer")
    duration_s: float | None = None
    seed: int = 1
    numbers: dict[str, float] = field(default_factory=dict)

    @property
    def words(self) -> list[str]:
        """The same as words behind `benchtool`."""
        words = ["simulate", "pitch", "--rig", self.rig, "--gains", self.gains]
        words += ["--controllers", ",".join(self.controllers), "--schedule", self.schedule]
        if self.duration_s is not None:
            words += ["--duration-s", f"{self.duration_s:.10g}"]
        return [*words, "--seed", str(self.seed), *set_words(self.numbers)]

    def setup(self) -> PitchSetup:
        """Return what is simulated.

        Raises:
            InputError: a name or number that cannot be.
        """
        require_controllers(self.controllers)
        setup = pitch_setup(
            rig=self.rig, gains=self.gains, controllers=self.controllers, schedule=self.schedule
        )
        setup = changed(setup, self.numbers)
        if self.duration_s is None:
            return setup
        return replace(setup, schedule=setup.schedule.lasting(self.duration_s))

    def preview(self, quick: bool) -> SimulationPreview:
        """Simulate, for the page."""
        from benchtool.report.pitch_preview import pitch_preview

        return pitch_preview(self.setup(), self.seed, quick=quick)

    def write(self, folder: Path) -> list[Path]:
        """Simulate, and write what the command writes with --out."""
        from benchtool.report.flight.pitch_study import pitch_study, write_study

        return write_study(pitch_study(self.setup(), self.seed), folder)


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


def set_words(numbers: dict[str, float]) -> list[str]:
    """Return `--set` options."""
    return [word for name, value in numbers.items() for word in ("--set", f"{name}={value:.10g}")]


def require_controllers(controllers: tuple[str, ...]) -> None:
    """Refuse a simulation under nobody."""
    if not controllers:
        raise InputError("no controller is chosen; choose one or more")
