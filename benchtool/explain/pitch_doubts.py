"""Doubts about a pitch recording that no effect explains: units, signs, rotors in another order.

A wrong unit or a turned sign makes every effect look small beside it. It is refused, with what to
mend, before anything is named.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from benchtool.aero.mixer import pitch_moment_Nm
from benchtool.core.rig import Rig
from benchtool.errors import InputError
from benchtool.simulate.pitch_follow import LoggedPitch

Array = NDArray[np.float64]

STEEPEST_RAD = 1.6
"""No beam on a hinge turns farther; an angle in degrees does at once."""

SMOOTHED_S = 0.05
"""Width of the quadratic whose slope is a rate or an acceleration; a choice."""

SURE = 0.6
"""Correlation from which a slope is believed."""

FACTOR = 3.0
"""A gyro that is off by more than this factor has another unit or sign, no error of scale."""

STILL = 5.0
"""A beam that moves less than so many standard deviations of its sensor's noise stands still."""


def refuse_doubtful(logged: LoggedPitch, rig: Rig, name: str) -> None:
    """Refuse a log whose columns contradict each other.

    Raises:
        InputError: an angle no beam can have, rates against the angle, thrust against the motion.
    """
    theta = logged.theta_rad
    steepest = float(np.nanmax(np.abs(theta)))
    if steepest > STEEPEST_RAD:
        raise InputError(
            f"theta_rad of {name} reaches {steepest:.3g} rad and a hinge ends at "
            f"{STEEPEST_RAD:g}; state the column's unit in the model's [columns], unit = \"deg\" "
            f"perhaps"
        )
    slope = _slope_of(_change(theta, logged.rate_Hz), logged.gyro_rad_s)
    if slope is not None and not 1.0 / FACTOR < slope < FACTOR:
        raise InputError(
            f"gyro_rad_s of {name} is {slope:.2g} times the change of theta_rad and should be "
            f"once; mend the sign or the unit of one of them in the model's [columns]"
        )
    rate = logged.gyro_rad_s if np.isfinite(logged.gyro_rad_s).any() else None
    acceleration = (
        _change(rate, logged.rate_Hz)
        if rate is not None
        else _change(_change(theta, logged.rate_Hz), logged.rate_Hz)
    )
    turned = _correlation(_pushed(logged, rig), acceleration)
    if turned < -SURE:
        raise InputError(
            f"the beam of {name} turns against its thrust (correlation {turned:.2f}): rotors or "
            f"the sign of theta_rad are not as rig {rig.name!r} has them; exchange the columns of "
            f"the rotors or turn the sign in the model's [columns]"
        )


def standing_still(logged: LoggedPitch, rig: Rig) -> str:
    """Return what to say of a beam that hardly moves; empty of one that does."""
    known = logged.theta_rad[np.isfinite(logged.theta_rad)]
    sensor = rig.sensors.get("theta_rad")
    noise = max(sensor.noise, sensor.quantum) if sensor is not None else 1e-4
    moved = float(np.std(known))
    if moved > STILL * noise:
        return ""
    return (
        f"the beam hardly moves ({np.degrees(moved):.2g} deg, root mean square), so little can be "
        f"judged; record steps and slow reversals of the attitude, as the schedule identify has"
    )


def _change(values: Array, rate_Hz: float) -> Array:
    """Return the slope of values (n,) per second, smoothed; blank ones bridged."""
    known = np.isfinite(values)
    rows = np.arange(len(values))
    whole = np.interp(rows, rows[known], values[known])
    width = max(5, 2 * round(0.5 * SMOOTHED_S * rate_Hz) + 1)
    out: Array = savgol_filter(whole, width, 2, deriv=1, delta=1.0 / rate_Hz)
    return out


def _pushed(logged: LoggedPitch, rig: Rig) -> Array:
    """Return the torque of the rotors (n,), out of ground effect, lag as the rig's: N m."""
    p = rig.propulsion
    speed = p.speed_per_us_rad_s * np.maximum(logged.pwm_us - p.pwm_start_us, 0.0)
    late = round(p.lag_s * logged.rate_Hz) if not logged.turned else 0
    if late:
        speed = np.concatenate([np.repeat(speed[:, :1], late, axis=1), speed[:, :-late]], axis=1)
    thrust = p.thrust_coefficient_N_s2 * speed**2
    return np.asarray(pitch_moment_Nm(thrust, rig.disc_positions_m[:, 0]), float)


def _slope_of(x: Array, y: Array) -> float | None:
    """Return how many times x the readings y are; None where nothing tells."""
    if abs(_correlation(x, y)) < SURE:
        return None
    both = np.isfinite(x) & np.isfinite(y)
    return float(x[both] @ y[both] / (x[both] @ x[both]))


def _correlation(x: Array, y: Array) -> float:
    both = np.isfinite(x) & np.isfinite(y)
    if both.sum() < 3 or np.ptp(x[both]) == 0.0 or np.ptp(y[both]) == 0.0:
        return 0.0
    return float(np.corrcoef(x[both], y[both])[0, 1])
