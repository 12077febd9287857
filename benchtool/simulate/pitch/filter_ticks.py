"""Filter a logged pitch experiment: the plant driven by logged pulses, corrected by the readings.

The same plant as in a closed loop, with a filter of constant gain around it. What the readings
show beyond the prediction of one tick is the innovation; with the right model it is white noise of
known size, whatever controller made the pulses. Every lane filters the same log with parameters
of its own, so that a derivative costs no more than a run.
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

FREE, CORRECT, RESTART = range(3)  # run on without readings, correct by them, restart from them

LoggedTick = namedtuple("LoggedTick", "setpoint pwm_us mode theta_rad gyro_rad_s speed_rad_s")
"""One column of a log: what holds of a schedule (`records.Tick`); what to do with the tick, and
what was read: pitch (rad), gyro (rad/s), speed of each disc (rad/s); nan where nothing was.
"""


def logged_slot(n_discs: int) -> Slot:
    """Return the slot of one column of a log for so many discs."""
    discs = (0.0,) * n_discs
    return Slot(0, LoggedTick(Setpoint(), discs, 0.0, 0.0, 0.0, discs))


FilterGains = namedtuple(
    "FilterGains",
    "theta_by_theta theta_by_gyro rate_by_theta rate_by_gyro wake_by_theta wake_by_gyro speed",
    defaults=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
)
"""Gains from the errors of pitch and gyro to pitch, rate and random torque, and from a speed's
error to the speed.
"""

GAINS = Slot(0, FilterGains())


@inlined_expression
def correct_lane(w: Any, lane: Any, at: Any, now: Any, by: Any, to: Any, hooks: Any) -> None:
    """Predict the readings of a tick and correct one lane's state by what was read."""
    logged = now.wanted
    hinge, rotors = read_record(w, to.hinge, lane, at), read_record(w, to.rotors, lane, at)
    shown = read_record(w, to.readings, lane, at)
    p = read_record(w, to.effects, lane, at)
    gyro = hooks.gyro(now.time_s, hinge.theta_rad, hinge.rate_rad_s, hinge.acceleration_rad_s2, p)
    predicted = SensorReadings(hinge.theta_rad, gyro, shown.plate_z_m, rotors.speed_rad_s)
    write_record(w, to.readings, lane, at, predicted)
    pitch_error, rate_error = logged.theta_rad - hinge.theta_rad, logged.gyro_rad_s - gyro
    pitch_error = pitch_error if pitch_error == pitch_error else 0.0
    rate_error = rate_error if rate_error == rate_error else 0.0
    theta, rate, wake = hinge.theta_rad, hinge.rate_rad_s, hinge.wake_Nm
    if logged.mode == CORRECT:
        theta = theta + (by.theta_by_theta * pitch_error + by.theta_by_gyro * rate_error)
        rate = rate + (by.rate_by_theta * pitch_error + by.rate_by_gyro * rate_error)
        wake = wake + (by.wake_by_theta * pitch_error + by.wake_by_gyro * rate_error)
    elif logged.mode == RESTART:
        theta, rate, wake = theta + pitch_error, rate + rate_error, 0.0
    speeds = rotors.speed_rad_s
    for i in range(len(speeds)):
        error = logged.speed_rad_s[i] - speeds[i]
        error = error if error == error else 0.0
        if logged.mode == CORRECT:
            speeds = with_fields(speeds, i, speeds[i] + by.speed * error)
        elif logged.mode == RESTART:
            speeds = with_fields(speeds, i, speeds[i] + error)
    corrected = Hinge(
        theta, rate, wake, hinge.bent, hinge.clamped_steps, hinge.stopped_steps,
        hinge.acceleration_rad_s2,
    )  # fmt: skip
    write_record(w, to.hinge, lane, at, corrected)
    write_record(w, to.rotors, lane, at, Rotors(speeds))
