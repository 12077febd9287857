"""Stages that move the plate: the device, a G-code stage, or the operator."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import inf, nan
from types import MappingProxyType

from benchtool.bench.guard import GuardedBench
from benchtool.core.errors import StageError
from benchtool.core.rig import PlateDrive

# pause(s) waits for s seconds while the bench is read; stages call it instead of sleeping.
Pause = Callable[[float], None]

MANUAL_TOLERANCE_M = 0.002  # of an operator's measurement: two marks of a ruler; assumed
MAX_DIFFERENCE_M = 0.005  # of the distance that the operator types from the requested one
MAX_ATTEMPTS = 3
OVERSHOOT_BACKLASHES = 5.0  # overshoot of a move away from the rotor, in backlashes; assumed


class PlateStage:
    """Stage interface; every method blocks until it is done or has failed.

    The base is a bench without a plate, or with a parked one. A subclass implements `_move_once`.

    Every distance is approached from the far side, by an overshoot. Without it a distance varies by
    the backlash with the direction of the last move: a scatter that grows towards the plate and
    biases R and K_b. With it the backlash does not affect a distance if the zero was measured after
    the same approach; otherwise it is a plate offset. Without a `plate` moves do not overshoot.
    """

    # Metadata for the run; `stage` is the value of `--stage` for the next part
    facts: Mapping[str, str | float] = MappingProxyType({"stage": "none"})
    position_uncertainty_m = 0.0  # of the reported position, added to the rig's tolerance

    def __init__(self, plate: PlateDrive | None = None, guard: GuardedBench | None = None) -> None:
        self._guard = guard  # checks before and after moves; None if moves pass through it
        self._overshoot_m = OVERSHOOT_BACKLASHES * plate.backlash_m if plate else 0.0
        self._max_m = plate.z_max_m if plate else inf
        self._last_target_m: float | None = None

    def open(self) -> None:
        """Open the port and home the stage if needed; by default a no-op.

        Raises:
            LinkError: the stage's port is not available.
            StageError: it replies, but cannot be made ready.
        """

    def move(self, z_m: float, x_m: float, tilt_rad: float, pause: Pause) -> float:
        """Move to a distance, lateral position and tilt; return the distance reached: m.

        Raises:
            StageError: it rejected the move, raised an alarm, or did not arrive in time.
        """
        is_moving_away = self._last_target_m is None or z_m > self._last_target_m
        past_m = min(z_m + self._overshoot_m, self._max_m)
        for target_z_m in (past_m, z_m) if is_moving_away and past_m > z_m else (z_m,):
            if self._guard is not None:
                self._guard.check_ready_for_move(target_z_m, x_m, tilt_rad)
            reached_m = self._move_once(target_z_m, x_m, tilt_rad, pause)
            if self._guard is not None:
                self._guard.confirm_plate(target_z_m, reached_m, self.position_uncertainty_m)
        self._last_target_m = z_m
        return reached_m

    def _move_once(self, z_m: float, x_m: float, tilt_rad: float, pause: Pause) -> float:
        """Move straight to a position; return the distance reached, nan without a plate: m."""
        return nan

    def hold(self) -> None:
        """Stop at the present position immediately."""
        self._last_target_m = None

    def close(self) -> None:
        """Release the stage; safe to call twice, never raises. By default a no-op."""


class DeviceStage(PlateStage):
    """Plate that the bench moves."""

    facts = MappingProxyType({"stage": "device"})

    def __init__(self, bench: GuardedBench, plate: PlateDrive | None = None) -> None:
        super().__init__(plate)
        self._bench = bench

    def _move_once(self, z_m: float, x_m: float, tilt_rad: float, pause: Pause) -> float:
        self._bench.move_plate(z_m, x_m, tilt_rad)
        return z_m

    def hold(self) -> None:
        super().hold()
        self._bench.stop()


class HandStage(PlateStage):
    """Plate that the operator moves; the typed distance is checked."""

    facts = MappingProxyType({"stage": "hand"})
    position_uncertainty_m = MANUAL_TOLERANCE_M

    def __init__(
        self, ask: Callable[[str], str], plate: PlateDrive, guard: GuardedBench | None = None
    ) -> None:
        super().__init__(guard=guard)
        self._ask, self._plate = ask, plate

    def _move_once(self, z_m: float, x_m: float, tilt_rad: float, pause: Pause) -> float:
        """Ask the operator for the distance that was set, in millimetres as on a ruler."""
        target = f"{1e3 * z_m:.1f} mm"
        if x_m:
            target += f", {1e3 * x_m:+.1f} mm sideways"
        if tilt_rad:
            target += f", tilted {57.29577951308232 * tilt_rad:+.1f} degrees"
        question = f"Move the plate to {target}, then type the distance that you measure in mm: "
        problem = ""
        for _ in range(MAX_ATTEMPTS):
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
            f"the plate was not set to {1e3 * z_m:.1f} mm after {MAX_ATTEMPTS} attempts: "
            f"{problem.strip() or 'no number was typed'}; set it and start again"
        )

    def _check_distance(self, measured_m: float, target_m: float) -> str:
        low_m, high_m = self._plate.z_min_m, self._plate.z_max_m
        if not low_m <= measured_m <= high_m:
            return (
                f"{1e3 * measured_m:.1f} mm is outside {1e3 * low_m:.1f} to {1e3 * high_m:.1f} mm. "
            )
        off_m = measured_m - target_m
        if abs(off_m) > MAX_DIFFERENCE_M:
            return (
                f"{1e3 * measured_m:.1f} mm is {1e3 * abs(off_m):.1f} mm off, tolerance "
                f"{1e3 * MAX_DIFFERENCE_M:.1f} mm. "
            )
        return ""
