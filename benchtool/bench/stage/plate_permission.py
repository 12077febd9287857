"""May the plate move now? Only within its travel, with motors at idle and rotors that are slow."""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from benchtool.bench.spin_down import LOOK_S, SPIN_DOWN_S
from benchtool.bench.stage.plate_check import PlateCheck
from benchtool.core.errors import StageError
from benchtool.core.rig import Rig

if TYPE_CHECKING:
    from benchtool.bench.guard import GuardedBench

Array = NDArray[np.float64]

PLATE_S = 5.0
"""A position reading may lag behind the plate for so long after a move. A choice: range finders are
averaged over about a second, and the seconds of a virtual bench may pass 20 times faster than those
of its link."""


def check_travel(rig: Rig, z_m: float, x_m: float, tilt_rad: float) -> None:
    """Refuse a place outside of the plate's travel.

    Raises:
        StageError: the position against its limit.
    """
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


def wait_for_idle(bench: GuardedBench, rig: Rig) -> None:
    """Refuse motors that are commanded above idle, and wait for rotors that are still fast.

    Raises:
        StageError: a pulse above idle, or rotors that do not slow down.
    """
    pulse, pwm_us = rig.propulsion, bench.pwm_us
    # The device's own word, else the rig's.
    told_us = bench.identity.pwm_idle_us
    idle_us = pulse.pwm_start_us if told_us is None else told_us
    if (pwm_us > idle_us).any():
        motor = int(np.argmax(pwm_us))
        raise StageError(
            f"the plate was not moved: motor {motor + 1} is commanded {pwm_us[motor]:g} "
            f"us, above idle at {idle_us:g} us; command idle first"
        )
    at_idle_rad_s = pulse.speed_per_us_rad_s * max(idle_us - pulse.pwm_start_us, 0.0)
    slow_rpm = 1.5 * at_idle_rad_s * 30.0 / np.pi + 60.0
    names = [channel.name for channel in bench.identity.channels]
    columns = [i for i, name in enumerate(names) if name.rstrip("0123456789") == "rpm"]
    if not columns:
        return
    until_s = bench.now_s() + SPIN_DOWN_S
    while True:
        rpm = bench.listen(LOOK_S).values[:, columns]
        whole = np.flatnonzero(np.isfinite(rpm).all(axis=1))
        if len(whole) and (rpm[whole[-1]] <= slow_rpm).all():
            return
        if bench.now_s() > until_s:
            fastest = float(np.max(rpm[whole[-1]])) if len(whole) else float("nan")
            raise StageError(
                f"the plate was not moved: a rotor still turns at {fastest:.0f} rpm "
                f"{SPIN_DOWN_S:g} s after idle was commanded, limit {slow_rpm:.0f} rpm; look "
                f"at its ESC and its rpm channel"
            )


def wait_for_plate(
    bench: GuardedBench, plate: PlateCheck, target_m: float, stage_m: float, more_m: float
) -> StageError | None:
    """Read on until the bench reads the plate where it was sent; return what disagrees.

    Args:
        bench: read meanwhile.
        plate: compares.
        target_m: where the plate was sent.
        stage_m: where what moved it says that it stands.
        more_m: allowed on top of the tolerance.
    """
    plate.arrives()
    until_s = bench.now_s() + PLATE_S
    while True:
        bench.listen(LOOK_S)
        problem = plate.problem(target_m, stage_m, more_m)
        if problem is None or bench.now_s() > until_s:
            return problem
