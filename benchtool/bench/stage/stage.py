"""The seam for moving the plate: by the device itself, by a G-code stage, or by hand."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Protocol

from benchtool.bench.bench import Bench
from benchtool.core.errors import StageError
from benchtool.core.rig import PlateDrive

if TYPE_CHECKING:
    from benchtool.bench.guard import GuardedBench

Pause = Callable[[float], None]
"""pause(s): wait about so long; whoever moves the plate calls it instead of sleeping, so that the
bench is listened to meanwhile."""

MANUAL_TOLERANCE_M = (
    0.002  # difference of a person's measurement from a reading: two marks; assumed
)


class PlateStage(Protocol):
    """Move the plate; every method blocks until it is done or has failed."""

    @property
    def facts(self) -> Mapping[str, str | float]:
        """What moves the plate, for the run's metadata; `stage` is the `--stage` to say again."""

    @property
    def measures_to_m(self) -> float:
        """How far its word may be from a reading beyond what the rig allows."""

    def open(self) -> None:
        """Get ready; homes where that is needed.

        Raises:
            LinkError: the stage's port cannot be had.
            StageError: it answers, but cannot be made ready.
        """

    def move(self, z_m: float, x_m: float, tilt_rad: float, pause: Pause) -> float:
        """Move to a distance, lateral position and tilt; return the distance that was reached: m.

        Raises:
            StageError: it refused, alarmed, or did not arrive in time.
        """

    def hold(self) -> None:
        """Stop moving at once, where it is."""

    def close(self) -> None:
        """Let go; safe to call twice, never raises."""


class DeviceStage:
    """Let the bench move its own plate."""

    facts: Mapping[str, str | float] = MappingProxyType({"stage": "device"})
    measures_to_m = 0.0

    def __init__(self, bench: Bench) -> None:
        self._bench = bench

    def open(self) -> None:
        """Do nothing: the bench is opened by whoever owns it."""

    def move(self, z_m: float, x_m: float, tilt_rad: float, pause: Pause) -> float:
        self._bench.move_plate(z_m, x_m, tilt_rad)
        return z_m

    def hold(self) -> None:
        self._bench.stop()

    def close(self) -> None:
        """Do nothing, as in `open`."""


class NoStage:
    """Move nothing: there is no plate, or it is far away."""

    facts: Mapping[str, str | float] = MappingProxyType({"stage": "none"})
    measures_to_m = 0.0

    def open(self) -> None:
        """Do nothing: there is no stage."""

    def move(self, z_m: float, x_m: float, tilt_rad: float, pause: Pause) -> float:
        return float("nan")

    def hold(self) -> None:
        """Do nothing, as in `open`."""

    def close(self) -> None:
        """Do nothing, as in `open`."""


class ManualStage:
    """Let the operator move the plate and check what they say.

    Args:
        tolerance_m: how far the distance typed in may be from the requested one.
        tries: how often the question is repeated after a wrong answer.
    """

    facts: Mapping[str, str | float] = MappingProxyType({"stage": "hand"})
    measures_to_m = MANUAL_TOLERANCE_M

    def __init__(
        self,
        ask: Callable[[str], str],
        plate: PlateDrive,
        tolerance_m: float = 0.005,
        tries: int = 3,
    ) -> None:
        self._ask = ask
        self._plate = plate
        self._tolerance_m = tolerance_m
        self._tries = tries

    def open(self) -> None:
        """Do nothing: there is no port."""

    def move(self, z_m: float, x_m: float, tilt_rad: float, pause: Pause) -> float:
        """Ask for the distance that was set, in millimetres as a ruler shows it."""
        place = f"{1e3 * z_m:.1f} mm"
        if x_m:
            place += f", {1e3 * x_m:+.1f} mm sideways"
        if tilt_rad:
            place += f", tilted {57.29577951308232 * tilt_rad:+.1f} degrees"
        question = f"Move the plate to {place}, then type the distance that you measure in mm: "
        problem = ""
        for _ in range(self._tries):
            answer = self._ask(problem + question).strip().removesuffix("mm").strip()
            try:
                measured_m = 1e-3 * float(answer.replace(",", "."))
            except ValueError:
                problem = f"{answer!r} is not a number. "
                continue
            problem = self._problem(measured_m, z_m)
            if not problem:
                return measured_m
        raise StageError(
            f"the plate was not set to {1e3 * z_m:.1f} mm after {self._tries} tries: "
            f"{problem.strip() or 'no number was typed'}; set it and start again"
        )

    def hold(self) -> None:
        """Do nothing: nobody pushes."""

    def close(self) -> None:
        """Do nothing, as in `open`."""

    def _problem(self, measured_m: float, target_m: float) -> str:
        low_m, high_m = self._plate.z_min_m, self._plate.z_max_m
        if not low_m <= measured_m <= high_m:
            return (
                f"{1e3 * measured_m:.1f} mm is outside {1e3 * low_m:.1f} to {1e3 * high_m:.1f} mm. "
            )
        off_m = measured_m - target_m
        if abs(off_m) > self._tolerance_m:
            return (
                f"{1e3 * measured_m:.1f} mm is {1e3 * abs(off_m):.1f} mm off, tolerance "
                f"{1e3 * self._tolerance_m:.1f} mm. "
            )
        return ""


class _StageWrapper:
    """Be another stage; a wrapper says how it moves."""

    def __init__(self, stage: PlateStage) -> None:
        self._stage = stage

    @property
    def facts(self) -> Mapping[str, str | float]:
        return self._stage.facts

    @property
    def measures_to_m(self) -> float:
        return self._stage.measures_to_m

    def open(self) -> None:
        self._stage.open()

    def hold(self) -> None:
        self._stage.hold()

    def close(self) -> None:
        self._stage.close()


class FixedStage(_StageWrapper):
    """Be another stage that asks first whether the plate may move, and then whether it did."""

    def __init__(self, stage: PlateStage, guard: GuardedBench) -> None:
        super().__init__(stage)
        self._guard = guard

    def move(self, z_m: float, x_m: float, tilt_rad: float, pause: Pause) -> float:
        self._guard.ready_for_move(z_m, x_m, tilt_rad)
        reached_m = self._stage.move(z_m, x_m, tilt_rad, pause)
        self._guard.confirm_plate(z_m, reached_m, self._stage.measures_to_m)
        return reached_m


OVERSHOOT_BACKLASHES = 5.0  # way past a distance that is approached from nearer; assumed


class BacklashCompensatedStage(_StageWrapper):
    """Be another stage that overshoots when it moves away, and comes back.

    Without it a distance stands nearer or farther by the play, as the last move happened to go: a
    scatter that grows towards the plate and pulls R and K_b apart. With it the play is no part of a
    distance where the zero was measured after the same approach; else it is a plate offset.

    Args:
        stage: moves the plate by itself (no operator).
    """

    def __init__(self, stage: PlateStage, plate: PlateDrive) -> None:
        super().__init__(stage)
        self._overshoot_m = OVERSHOOT_BACKLASHES * plate.backlash_m
        self._farthest_m = plate.z_max_m
        self._standing_m: float | None = None

    def move(self, z_m: float, x_m: float, tilt_rad: float, pause: Pause) -> float:
        away = self._standing_m is None or z_m > self._standing_m
        past_m = min(z_m + self._overshoot_m, self._farthest_m)
        if away and past_m > z_m:
            self._stage.move(past_m, x_m, tilt_rad, pause)
        reached_m = self._stage.move(z_m, x_m, tilt_rad, pause)
        self._standing_m = z_m
        return reached_m

    def hold(self) -> None:
        self._standing_m = None
        self._stage.hold()
