"""What the page asks of the pitch bench: names and numbers, and the command that asks the same."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from benchtool.errors import InputError
from benchtool.library import schedule_named
from benchtool.studies.pitch_setup import PLATE_DISTANCE, PitchSetup, changed, pitch_setup
from benchtool.web.simulate.slider import Slider

if TYPE_CHECKING:
    from benchtool.studies.preview import Preview

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

    def preview(self, quick: bool) -> Preview:
        """Simulate, for the page."""
        from benchtool.studies.pitch_preview import pitch_preview

        return pitch_preview(self.setup(), self.seed, quick=quick)

    def write(self, folder: Path) -> list[Path]:
        """Simulate, and write what the command writes with --out."""
        from benchtool.studies.pitch import pitch_study, write_study

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
