"""Hinge, rotors and sensors of one lane, which is column `lane` of the records.

The hinge is integrated by the midpoint rule with an implicit step for dry friction: second order
when it slips, exactly at rest when it sticks. The lag of rotor speeds is exact, also if a delayed
command arrives within a step.

A filter along a log has the same plant. Readings minus the prediction of one tick are the
innovations; for the correct model they are white noise of known size, for any controller. Every
lane filters the same log with different parameters, so that a derivative costs no more than a run.
"""

from __future__ import annotations

from collections import namedtuple
from typing import Any

import numpy as np

from benchtool.physics.expression import (
    Quantity,
    at_least,
    expression,
    inlined_expression,
    read_record,
    with_fields,
    write_record,
)
from benchtool.physics.images import Plane, height_over
from benchtool.physics.rotor import pitch_moment_Nm
from benchtool.simulate.controllers.blocks import clip
from benchtool.simulate.hooks import Rotors, first_order_lag
from benchtool.simulate.noise import next_state, normal

MIN_DIVISOR = 1e-300  # avoids 0/0 for a hinge without friction

# Modes of a filter: predict without readings, correct by them, restart from them.
FREE, CORRECT, RESTART = range(3)

# State of the body: pitch (positive nose down), rate, random torque, elastic deflection of the dry
# friction as a share (-1 to 1) of its maximum torque; number of plant steps with a disc below the
# validity limit, and at the end stop; acceleration in the last step.
Hinge = namedtuple(
    "Hinge",
    "theta_rad rate_rad_s wake_Nm deflection clamped_steps stopped_steps acceleration_rad_s2",
    defaults=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
)

# True values with the delay of the sensors.
Delayed = namedtuple("Delayed", "theta_rad rate_rad_s plate_z_m", defaults=(0.0, 0.0, 0.0))

# Last readings; speeds per disc.
SensorReadings = namedtuple("SensorReadings", "theta_rad gyro_rad_s plate_z_m speed_rad_s")

# Scheduled attitude (rad), collective (N per rotor), true plate distance with the body level (m),
# and inserted share of the plate (0 to 1).
Setpoint = namedtuple(
    "Setpoint", "reference_rad collective_N plate_z_m plate_share", defaults=(0.0, 0.0, 0.0, 0.0)
)

# Numbers of hinge and rotors: plant step over inertia (s/(kg m2)), weight (N), k (N/(rad/s)2),
# effective radius (m), end stop (rad), and coverage of each disc by the fully inserted plate.
HingedBody = namedtuple("HingedBody", "step_over_inertia weight_N k radius_m stop_rad covered")

# Map from pulse width to speed: slope, and the pulse width at which a rotor starts.
PulseMap = namedtuple("PulseMap", "slope_rad_s_per_us start_us")

PulseLimits = namedtuple("PulseLimits", "min_us max_us quantum_us")

SensorErrors = namedtuple("SensorErrors", "noise bias quantum")  # standard deviation of the noise

Sensors = namedtuple("Sensors", "theta gyro plate speed")  # errors of all sensors of a pitch bench

# Gains from pitch and gyro innovations to pitch, rate and random torque, and of the speeds.
FilterGains = namedtuple(
    "FilterGains",
    "theta_by_theta theta_by_gyro rate_by_theta rate_by_gyro wake_by_theta wake_by_gyro speed",
    defaults=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
)


@expression
def sine(angle_rad: Quantity) -> Quantity:
    """Return the sine, error 5e-16 up to a quarter turn: Taylor's series to order 19."""
    v = angle_rad * angle_rad
    high = 1.0 / 6227020800.0 + v * (
        -1.0 / 1307674368000.0 + v * (1.0 / 355687428096000.0 - v * (1.0 / 121645100408832000.0))
    )
    low = 1.0 / 120.0 + v * (
        -1.0 / 5040.0 + v * (1.0 / 362880.0 - v * (1.0 / 39916800.0 - v * high))
    )
    return angle_rad * (1.0 - v * (1.0 / 6.0 - v * low))


@expression
def cosine(angle_rad: Quantity) -> Quantity:
    """Return the cosine, error 5e-16 up to a quarter turn: Taylor's series to order 20."""
    v = angle_rad * angle_rad
    high = 1.0 / 479001600.0 + v * (
        -1.0 / 87178291200.0
        + v
        * (
            1.0 / 20922789888000.0
            + v * (-1.0 / 6402373705728000.0 + v * (1.0 / 2432902008176640000.0))
        )
    )
    low = 1.0 / 24.0 + v * (-1.0 / 720.0 + v * (1.0 / 40320.0 - v * (1.0 / 3628800.0 - v * high)))
    return 1.0 - v * (0.5 - v * low)


@expression
def rounded(value: Any, quantum: Any) -> Any:
    """Return the value rounded to a multiple of the quantum; unchanged if the quantum is 0."""
    step = at_least(quantum, 1e-12)
    return value + (quantum > 0.0) * (np.floor(value / step + 0.5) * step - value)


@expression
def read(true: Any, draw: Any, sensor: Any) -> Any:
    """Return a sensor reading: true value plus bias and white noise, rounded to the quantum."""
    return rounded(true + sensor.bias + sensor.noise * draw, sensor.quantum)


@expression
def plane_below(plate_z_m: Any, theta_rad: Any, tilt_rad: Any) -> Any:
    """Return the plane of a plate with its centre below the hinge, tilted by an angle."""
    return Plane(plate_z_m * cosine(tilt_rad), -sine(theta_rad + tilt_rad), 0.0)


@expression
def heights_over(plane: Any, x_m: Any, y_m: Any) -> Any:
    """Return the height of each disc over the plate: m."""
    heights = x_m
    for i in range(len(x_m)):
        heights = with_fields(heights, i, height_over(plane, x_m[i], y_m[i]))
    return heights


@expression
def scaled(values: Any, factor: Any) -> Any:
    """Return the product of each disc's value and a number."""
    products = values
    for i in range(len(values)):
        products = with_fields(products, i, values[i] * factor)
    return products


@inlined_expression
def step_lane(w: Any, lane: Any, lanes: Any, states: Any, now: Any, slots: Any, hooks: Any) -> None:
    """Advance the bench of one lane by one plant step."""
    discs, time_s = now.geometry, now.time_s
    body = read_record(w, slots.body, lane, lanes)
    motion = read_record(w, slots.motion, lane, lanes)
    hinge = read_record(w, slots.hinge, lane, lanes)
    rotors = read_record(w, slots.rotors, lane, lanes)
    plate = read_record(w, slots.setpoint, lane, lanes)
    p = read_record(w, slots.effects, lane, lanes)
    targets = read_record(w, slots.targets, lane, lanes)
    old, new = targets.old_rad_s, targets.new_rad_s
    start_rad_s = rotors.speed_rad_s
    middle_rad_s = hooks.followed(
        start_rad_s, first_order_lag(motion.first, start_rad_s, old, new), p
    )
    end_rad_s = hooks.followed(
        middle_rad_s, first_order_lag(motion.second, middle_rad_s, old, new), p
    )
    write_record(w, slots.rotors, lane, lanes, Rotors(end_rad_s))

    x, dt_s, rate = discs.x_m, discs.dt_s, hinge.rate_rad_s
    theta = hinge.theta_rad + 0.5 * dt_s * rate
    plane = plane_below(plate.plate_z_m, theta, hooks.tilt(p))
    heights = heights_over(plane, x, discs.y_m)
    covered = scaled(body.covered, plate.plate_share)
    speed = middle_rad_s
    for i in range(len(x)):
        speed = with_fields(speed, i, discs.roots[i] * middle_rad_s[i])
    flow = hooks.bare(
        body.radius_m, x, discs.y_m, plane, heights, covered, speed, time_s, theta, rate,
        cosine(theta), body.weight_N,
    )  # fmt: skip
    flow = hooks.with_images(flow, discs.distances_m, discs.body, p)
    factor = hooks.factors(flow, p)
    flow = hooks.with_thrust(flow, rate, body.k, factor)
    hinge_torque = pitch_moment_Nm(flow.thrust_N, x) + hinge.wake_Nm
    share = body.step_over_inertia
    middle_rate = rate + 0.5 * share * (hinge_torque + hooks.torque(0, flow, p))
    flow = hooks.with_thrust(flow, middle_rate, body.k, factor)
    frictionless_rate = rate + share * (hinge_torque + hooks.torque(0, flow, p))
    friction_limit = share * hooks.dry_friction(0, flow, p)
    hinge_give = hooks.dry_give(0, flow, p) / dt_s
    stiffness_share = friction_limit / at_least(
        hinge_give + friction_limit + hooks.dry_width(0, flow, p), MIN_DIVISOR
    )
    friction = clip(
        (hinge_give * hinge.deflection + frictionless_rate) * stiffness_share, friction_limit
    )
    previous_rate, rate = rate, frictionless_rate - friction
    theta = theta + 0.5 * dt_s * rate
    clipped_theta = clip(theta, body.stop_rad)
    is_stopped = 1.0 * (clipped_theta != theta)
    is_clamped = 0.0 * is_stopped
    for i in range(len(x)):
        is_low = flow.height_m[i] <= hooks.nearest_z_over_R * body.radius_m
        is_clamped = at_least(is_clamped, is_low * (flow.coverage[i] > 0.0))
    first = next_state(states[lane])
    second = next_state(first)
    states[lane] = second
    wake = motion.wake_decay * hinge.wake_Nm + motion.wake_innovation_Nm * normal(first, second)
    next_hinge = Hinge(
        clipped_theta, (1.0 - is_stopped) * rate, wake,
        friction / at_least(friction_limit, MIN_DIVISOR), hinge.clamped_steps + is_clamped,
        hinge.stopped_steps + is_stopped, (rate - previous_rate) / dt_s,
    )  # fmt: skip
    write_record(w, slots.hinge, lane, lanes, next_hinge)


@inlined_expression
def sense_lane(
    w: Any, lane: Any, lanes: Any, states: Any, fresh: Any, time_s: Any, slots: Any, hooks: Any
) -> None:
    """Write the readings of one lane; `fresh` is 1 for sensors with a new reading."""
    previous = read_record(w, slots.readings, lane, lanes)
    delayed = read_record(w, slots.delayed, lane, lanes)
    sensors = read_record(w, slots.sensors, lane, lanes)
    rotors = read_record(w, slots.rotors, lane, lanes)
    p = read_record(w, slots.effects, lane, lanes)
    acceleration = read_record(w, slots.hinge, lane, lanes).acceleration_rad_s2
    a = next_state(states[lane])
    b = next_state(a)
    theta = read(delayed.theta_rad, normal(a, b), sensors.theta)
    a = next_state(b)
    b = next_state(a)
    gyro = hooks.gyro(time_s, delayed.theta_rad, delayed.rate_rad_s, acceleration, p)
    gyro = read(gyro, normal(a, b), sensors.gyro)
    a = next_state(b)
    b = next_state(a)
    plate = read(delayed.plate_z_m, normal(a, b), sensors.plate)
    speeds = previous.speed_rad_s
    for i in range(len(speeds)):
        a = next_state(b)
        b = next_state(a)
        speed = read(rotors.speed_rad_s[i], normal(a, b), sensors.speed)
        speeds = with_fields(speeds, i, speed if fresh.speed else previous.speed_rad_s[i])
    states[lane] = b
    readings = SensorReadings(
        theta if fresh.theta else previous.theta_rad,
        gyro if fresh.gyro else previous.gyro_rad_s,
        plate if fresh.plate else previous.plate_z_m,
        speeds,
    )
    write_record(w, slots.readings, lane, lanes, readings)


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
