"""Stages that move the plate: the device, a G-code stage, or the operator."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Protocol

from benchtool.bench.bench import Bench
from benchtool.core.errors import StageError
from benchtool.core.rig import PlateDrive

if TYPE_CHECKING:
    from benchtool.bench.guard import GuardedBench

# pause(s) waits for s seconds while the bench is read; stages call it instead of sleeping.
Pause = Callable[[float], None]

MANUAL_TOLERANCE_M = 0.002  # of an operator's measurement: two marks of a ruler; assumed


class PlateStage(Protocol):
    """Stage interface; every method blocks until it is done or has failed."""

    @property
    def facts(self) -> Mapping[str, str | float]:
        """Metadata for the run; `stage` is the value of `--stage` for the next part."""

    @property
    def position_uncertainty_m(self) -> float:
        """Uncertainty of the reported position, added to the rig's tolerance."""

    def open(self) -> None:
        """Open the port and home the stage if needed.

        Raises:
            LinkError: the stage's port is not available.
            StageError: it replies, but cannot be made ready.
        """

    def move(self, z_m: float, x_m: float, tilt_rad: float, pause: Pause) -> float:
        """Move to a distance, lateral position and tilt; return the distance reached: m.

        Raises:
            StageError: it rejected the move, raised an alarm, or did not arrive in time.
        """

    def hold(self) -> None:
        """Stop at the present position immediately."""

    def close(self) -> None:
        """Release the stage; safe to call twice, never raises."""


class DeviceStage:
    """Plate that the bench moves."""

    facts: Mapping[str, str | float] = MappingProxyType({"stage": "device"})
    position_uncertainty_m = 0.0

    def __init__(self, bench: Bench) -> None:
        self._bench = bench

    def open(self) -> None:
        """No-op; the bench's owner opens it."""

    def move(self, z_m: float, x_m: float, tilt_rad: float, pause: Pause) -> float:
        self._bench.move_plate(z_m, x_m, tilt_rad)
        return z_m

    def hold(self) -> None:
        self._bench.stop()

    def close(self) -> None:
        """No-op, as `open`."""


class NoStage:
    """Stage without a plate, or with a parked one."""

    facts: Mapping[str, str | float] = MappingProxyType({"stage": "none"})
    position_uncertainty_m = 0.0

    def open(self) -> None:
        """No-op; there is no stage."""

    def move(self, z_m: float, x_m: float, tilt_rad: float, pause: Pause) -> float:
        return float("nan")

    def hold(self) -> None:
        """No-op, as `open`."""

    def close(self) -> None:
        """No-op, as `open`."""


class ManualStage:
    """Plate that the operator moves; the typed distance is checked.

    Args:
        tolerance_m: largest difference of the typed from the requested distance.
        max_attempts: number of attempts.
    """

    facts: Mapping[str, str | float] = MappingProxyType({"stage": "hand"})
    position_uncertainty_m = MANUAL_TOLERANCE_M

    def __init__(
        self,
        ask: Callable[[str], str],
        plate: PlateDrive,
        tolerance_m: float = 0.005,
        max_attempts: int = 3,
    ) -> None:
        self._ask = ask
        self._plate = plate
        self._tolerance_m = tolerance_m
        self._tries = max_attempts

    def open(self) -> None:
        """No-op; there is no port."""

    def move(self, z_m: float, x_m: float, tilt_rad: float, pause: Pause) -> float:
        """Ask the operator for the distance that was set, in millimetres as on a ruler."""
        target = f"{1e3 * z_m:.1f} mm"
        if x_m:
            target += f", {1e3 * x_m:+.1f} mm sideways"
        if tilt_rad:
            target += f", tilted {57.29577951308232 * tilt_rad:+.1f} degrees"
        question = f"Move the plate to {target}, then type the distance that you measure in mm: "
        problem = ""
        for _ in range(self._tries):
            text = self._ask(problem + question).strip().removesuffix("mm").strip()
            try:
                measured_m = 1e-3 * float(text.replace(",", "."))
            except ValueError:
                problem = f"{text!r} is not a number. "
                continue
            problem = self._check_distance(measured_m, z_m)
            if not problem:
                return measured_m
        raise StageError(
            f"the plate was not set to {1e3 * z_m:.1f} mm after {self._tries} attempts: "
            f"{problem.strip() or 'no number was typed'}; set it and start again"
        )

    def hold(self) -> None:
        """No-op; the plate does not move on its own."""

    def close(self) -> None:
        """No-op, as `open`."""

    def _check_distance(self, measured_m: float, target_m: float) -> str:
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
    """Wrapper that forwards all but `move`."""

    def __init__(self, stage: PlateStage) -> None:
        self._stage = stage

    @property
    def facts(self) -> Mapping[str, str | float]:
        return self._stage.facts

    @property
    def position_uncertainty_m(self) -> float:
        return self._stage.position_uncertainty_m

    def open(self) -> None:
        self._stage.open()

    def hold(self) -> None:
        self._stage.hold()

    def close(self) -> None:
        self._stage.close()


class GuardedStage(_StageWrapper):
    """Wrapper that checks with the guard before and after each move."""

    def __init__(self, stage: PlateStage, guard: GuardedBench) -> None:
        super().__init__(stage)
        self._guard = guard

    def move(self, z_m: float, x_m: float, tilt_rad: float, pause: Pause) -> float:
        self._guard.check_ready_for_move(z_m, x_m, tilt_rad)
        reached_m = self._stage.move(z_m, x_m, tilt_rad, pause)
        self._guard.confirm_plate(z_m, reached_m, self._stage.position_uncertainty_m)
        return reached_m


OVERSHOOT_BACKLASHES = 5.0  # overshoot of a move away from the rotor, in backlashes; assumed


class BacklashCompensatedStage(_StageWrapper):
    """Wrapper that approaches every distance from the far side, by an overshoot.

    Without it a distance varies by the backlash with the direction of the last move: a scatter that
    grows towards the plate and biases R and K_b. With it the backlash does not affect a distance
    if the zero was measured after the same approach; otherwise it is a plate offset.

    Args:
        stage: moves the plate without an operator.
    """

    def __init__(self, stage: PlateStage, plate: PlateDrive) -> None:
        super().__init__(stage)
        self._overshoot_m = OVERSHOOT_BACKLASHES * plate.backlash_m
        self._max_m = plate.z_max_m
        self._last_target_m: float | None = None

    def move(self, z_m: float, x_m: float, tilt_rad: float, pause: Pause) -> float:
        is_moving_away = self._last_target_m is None or z_m > self._last_target_m
        past_m = min(z_m + self._overshoot_m, self._max_m)
        if is_moving_away and past_m > z_m:
            self._stage.move(past_m, x_m, tilt_rad, pause)
        reached_m = self._stage.move(z_m, x_m, tilt_rad, pause)
        self._last_target_m = z_m
        return reached_m

    def hold(self) -> None:
        self._last_target_m = None
        self._stage.hold()
