"""Filter along a logged pitch experiment: logged pulse widths drive the plant, readings correct it.

The plant is that of the closed loop, with a filter of constant gain. Readings minus the prediction
of one tick are the innovations; for the correct model they are white noise of known size, for any
controller. Every lane filters the same log with different parameters, so that a derivative costs no
more than a run.
"""

from __future__ import annotations

from collections import namedtuple
from typing import Any

from benchtool.physics.expression import (
    Slot,
    inlined_expression,
    read_record,
    with_fields,
    write_record,
)
from benchtool.simulate.motors import Rotors
from benchtool.simulate.pitch.records import Hinge, SensorReadings, Setpoint

FREE, CORRECT, RESTART = range(3)  # predict without readings, correct by them, restart from them

# One column of a log: setpoint and pulse widths as in `records.Tick`, filter mode, and readings of
# pitch (rad), gyro (rad/s) and speed of each disc (rad/s); nan where there is none.
LoggedTick = namedtuple("LoggedTick", "setpoint pwm_us mode theta_rad gyro_rad_s speed_rad_s")


def logged_slot(n_discs: int) -> Slot:
    """Return the slot of one column of a log."""
    discs = (0.0,) * n_discs
    return Slot(0, LoggedTick(Setpoint(), discs, 0.0, 0.0, 0.0, discs))


# Gains from pitch and gyro innovations to pitch, rate and random torque, and of the speeds.
FilterGains = namedtuple(
    "FilterGains",
    "theta_by_theta theta_by_gyro rate_by_theta rate_by_gyro wake_by_theta wake_by_gyro speed",
    defaults=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
)

GAINS = Slot(0, FilterGains())


@inlined_expression
def correct_lane(
    w: Any, lane: Any, lanes: Any, now: Any, gains: Any, slots: Any, hooks: Any
) -> None:
    """Predict the readings of a tick and correct the state of one lane by the logged readings."""
    logged = now.scheduled
    hinge = read_record(w, slots.hinge, lane, lanes)
    rotors = read_record(w, slots.rotors, lane, lanes)
    readings = read_record(w, slots.readings, lane, lanes)
    p = read_record(w, slots.effects, lane, lanes)
    gyro = hooks.gyro(now.time_s, hinge.theta_rad, hinge.rate_rad_s, hinge.acceleration_rad_s2, p)
    predicted = SensorReadings(hinge.theta_rad, gyro, readings.plate_z_m, rotors.speed_rad_s)
    write_record(w, slots.readings, lane, lanes, predicted)
    pitch_error, rate_error = logged.theta_rad - hinge.theta_rad, logged.gyro_rad_s - gyro
    pitch_error = pitch_error if pitch_error == pitch_error else 0.0
    rate_error = rate_error if rate_error == rate_error else 0.0
    theta, rate, wake = hinge.theta_rad, hinge.rate_rad_s, hinge.wake_Nm
    if logged.mode == CORRECT:
        theta = theta + (gains.theta_by_theta * pitch_error + gains.theta_by_gyro * rate_error)
        rate = rate + (gains.rate_by_theta * pitch_error + gains.rate_by_gyro * rate_error)
        wake = wake + (gains.wake_by_theta * pitch_error + gains.wake_by_gyro * rate_error)
    elif logged.mode == RESTART:
        theta, rate, wake = theta + pitch_error, rate + rate_error, 0.0
    speeds = rotors.speed_rad_s
    for i in range(len(speeds)):
        error = logged.speed_rad_s[i] - speeds[i]
        error = error if error == error else 0.0
        if logged.mode == CORRECT:
            speeds = with_fields(speeds, i, speeds[i] + gains.speed * error)
        elif logged.mode == RESTART:
            speeds = with_fields(speeds, i, speeds[i] + error)
    corrected = Hinge(
        theta, rate, wake, hinge.deflection, hinge.clamped_steps, hinge.stopped_steps,
        hinge.acceleration_rad_s2,
    )  # fmt: skip
    write_record(w, slots.hinge, lane, lanes, corrected)
    write_record(w, slots.rotors, lane, lanes, Rotors(speeds))
