"""Travel limits of the plate, and the check of its position after a move.

Only a measured position is trusted: a stage that counts its steps cannot detect lost steps, and a
position channel may be frozen.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite, nan

import numpy as np
from numpy.typing import NDArray

from benchtool.bench.motor_state import POLL_INTERVAL_S, SPIN_DOWN_S, MotorStateBench
from benchtool.core.channel import Channel
from benchtool.core.errors import StageError
from benchtool.core.rig import Rig, Sensor

PLATE_CHANNEL = "plate_z_m"
MIN_TOLERANCE_M = 0.001  # a change of 1 mm changes thrust by less than 2 %; assumed
NOISE_MULTIPLE = 4.0  # standard deviations of the sensor allowed for one reading


def plate_tolerance_m(rig: Rig) -> float:
    """Return the tolerance of a position reading: backlash, quantum and noise."""
    sensor = rig.sensors.get(PLATE_CHANNEL, Sensor())
    return MIN_TOLERANCE_M + rig.plate.backlash_m + sensor.quantum + NOISE_MULTIPLE * sensor.noise


class PlateCheck:
    """Check of the plate's position channel."""

    def __init__(self, channels: Sequence[Channel], rig: Rig) -> None:
        names = [channel.name for channel in channels]
        self.is_measured = PLATE_CHANNEL in names
        self.read_m = nan  # last reading, nan before the first
        self.tolerance_m = plate_tolerance_m(rig)
        self._column = names.index(PLATE_CHANNEL) if self.is_measured else -1
        self._rig = rig
        self._before_m = nan

    def update(self, values: NDArray[np.float64]) -> None:
        """Update the last reading from samples (m, c), in channel order."""
        if self.is_measured:
            present = values[np.isfinite(values[:, self._column]), self._column]
            if len(present):
                self.read_m = float(present[-1])

    def record_departure(self) -> None:
        """Record the position before a move."""
        self._before_m = self.read_m

    def record_arrival(self) -> None:
        """Discard earlier readings: the stage reports that the plate has arrived."""
        self.read_m = nan

    def find_error(
        self, target_m: float, stage_m: float, extra_tolerance_m: float = 0.0
    ) -> StageError | None:
        """Return an error if target, stage and reading disagree after a move, else None.

        The extra tolerance is for a position measured by hand and compared with the target.
        """
        allowed_m = self.tolerance_m + extra_tolerance_m
        after = f"after the move to {target_m:.4g} m"
        limit = f"tolerance {1e3 * allowed_m:.1f} mm"
        is_off = extra_tolerance_m == 0.0 and not abs(stage_m - target_m) <= allowed_m
        if not self.is_measured and is_off:
            return StageError(
                f"the stage reports {stage_m:.4f} m {after}, {limit}; check the axes, zero_mm and "
                f"direction of --stage"
            )
        if not self.is_measured:
            return None
        min_gap_m = self._rig.plate.z_min_m
        if not isfinite(self.read_m):
            return StageError(
                f"{PLATE_CHANNEL} has no reading {after}, so the plate position is unknown; "
                f"check the position sensor and its cable"
            )
        if self.read_m < min_gap_m - self.tolerance_m:
            return StageError(
                f"{PLATE_CHANNEL} reads {self.read_m:.4f} m {after}, inside the minimum gap of "
                f"{min_gap_m:g} m of rig {self._rig.name!r}; move the plate away by hand, then "
                f"check stage and sensor"
            )
        positions_m = (stage_m,) if extra_tolerance_m else (stage_m, target_m)
        if not is_off and all(abs(self.read_m - other_m) <= allowed_m for other_m in positions_m):
            return None
        stage = "" if stage_m == target_m else f", the stage reports {stage_m:.4f} m"
        if abs(self.read_m - self._before_m) <= allowed_m < abs(target_m - self._before_m):
            return StageError(
                f"{PLATE_CHANNEL} still reads {self.read_m:.4f} m {after}{stage}, {limit}: plate "
                f"did not move or its position channel is frozen; check both before motors turn"
            )
        return StageError(
            f"{PLATE_CHANNEL} reads {self.read_m:.4f} m {after}{stage}, {limit}; home the stage "
            f"and measure the distance by hand, then correct axis, zero, sensor or the rig's "
            f"sensors.{PLATE_CHANNEL} (noise, quantum)"
        )

    def check_position(
        self, stage_m: float, mean_m: float, extra_tolerance_m: float = 0.0
    ) -> StageError | None:
        """Return an error if the mean reading of a point differs from the stage position."""
        if not self.is_measured or abs(mean_m - stage_m) <= self.tolerance_m + extra_tolerance_m:
            return None
        if not isfinite(mean_m):
            return StageError(
                f"{PLATE_CHANNEL} has no reading during the point at {stage_m:.4g} m; check the "
                f"position sensor and its cable"
            )
        return StageError(
            f"the plate moved while motors turned: {PLATE_CHANNEL} reads {mean_m:.4f} m on average "
            f"at {stage_m:.4f} m, tolerance {1e3 * (self.tolerance_m + extra_tolerance_m):.1f} mm; "
            f"check the mount of the plate"
        )


# Largest lag of a position reading after a move; assumed: range finders are averaged over about a
# second, and the seconds of a virtual bench may pass 20 times faster than those of its link.
PLATE_TIMEOUT_S = 5.0


def check_travel(rig: Rig, z_m: float, x_m: float, tilt_rad: float) -> None:
    """Raise if a position is outside the plate's travel range."""
    plate = rig.plate
    if not plate.z_min_m <= z_m <= plate.z_max_m:
        raise StageError(
            f"the plate was not moved to {z_m:g} m, outside {plate.z_min_m:g} to "
            f"{plate.z_max_m:g} m of rig {rig.name!r}; choose a distance in between"
        )
    if not abs(x_m) <= rig.plate_x_max_m:
        raise StageError(
            f"the plate was not moved sideways to {x_m:g} m, limit {rig.plate_x_max_m:g} "
            f"m of rig {rig.name!r} to either side; choose a position in between"
        )
    if not isfinite(tilt_rad):
        raise StageError(f"the plate was not tilted to {tilt_rad:g} rad; give a finite angle")


def wait_for_idle(bench: MotorStateBench, rig: Rig) -> None:
    """Raise if motors are commanded above idle; wait for rotors that are still fast."""
    propulsion, pwm_us = rig.propulsion, bench.pwm_us
    # Value of the device; falls back to the rig's.
    reported_us = bench.identity.pwm_idle_us
    idle_us = propulsion.pwm_start_us if reported_us is None else reported_us
    if (pwm_us > idle_us).any():
        motor = int(np.argmax(pwm_us))
        raise StageError(
            f"the plate was not moved: motor {motor + 1} is commanded {pwm_us[motor]:g} "
            f"us, above idle at {idle_us:g} us; command idle first"
        )
    idle_rad_s = propulsion.speed_per_us_rad_s * max(idle_us - propulsion.pwm_start_us, 0.0)
    limit_rpm = 1.5 * idle_rad_s * 30.0 / np.pi + 60.0
    names = [channel.name for channel in bench.identity.channels]
    columns = [i for i, name in enumerate(names) if name.rstrip("0123456789") == "rpm"]
    if not columns:
        return
    deadline_s = bench.now_s() + SPIN_DOWN_S
    while True:
        rpm = bench.read_and_buffer(POLL_INTERVAL_S).values[:, columns]
        complete = np.flatnonzero(np.isfinite(rpm).all(axis=1))
        if len(complete) and (rpm[complete[-1]] <= limit_rpm).all():
            return
        if bench.now_s() > deadline_s:
            max_rpm = float(np.max(rpm[complete[-1]])) if len(complete) else float("nan")
            raise StageError(
                f"the plate was not moved: a rotor still turns at {max_rpm:.0f} rpm "
                f"{SPIN_DOWN_S:g} s after idle was commanded, limit {limit_rpm:.0f} rpm; check "
                f"its ESC and its rpm channel"
            )


def wait_for_plate(
    bench: MotorStateBench,
    plate: PlateCheck,
    target_m: float,
    stage_m: float,
    extra_tolerance_m: float,
) -> StageError | None:
    """Read until the plate reading agrees with target and stage; return an error at timeout."""
    plate.record_arrival()
    deadline_s = bench.now_s() + PLATE_TIMEOUT_S
    while True:
        if plate.is_measured:
            bench.read_and_buffer(POLL_INTERVAL_S)
        problem = plate.find_error(target_m, stage_m, extra_tolerance_m)
        if problem is None or not plate.is_measured or bench.now_s() > deadline_s:
            return problem
