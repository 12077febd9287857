"""What the page asks of a flight: names and numbers, and the command that asks the same."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from benchtool.library import gains_named, rig_named
from benchtool.simulate.flight import FlightControl
from benchtool.simulate.flight_cases import FLIGHTS
from benchtool.simulate.flight_vehicle import FlightVehicle
from benchtool.studies.flight_setup import FlightSetup, changed
from benchtool.web.simulate.pitch_ask import require_controllers, set_words
from benchtool.web.simulate.slider import Slider

if TYPE_CHECKING:
    from benchtool.studies.preview import Preview


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
        return changed(setup, self.numbers)

    def preview(self, quick: bool) -> Preview:
        """Simulate, for the page."""
        from benchtool.studies.flight_preview import flight_preview

        return flight_preview(self.setup(), self.controllers, self.seed, quick=quick)

    def write(self, folder: Path) -> list[Path]:
        """Simulate, and write what the command writes with --out."""
        from benchtool.studies.flight_report import fly_each, write_flights

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
