"""One lane's hinge, rotors and sensors; every function works on column `lane` of the work space.

The hinge is integrated by the midpoint rule with an implicit step for dry friction: second order
while it slips, exactly at rest while it sticks. Rotor speeds follow their lag exactly, also where a
delayed command arrives in the middle of a step.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from benchtool.physics.expression import (
    Quantity,
    expression,
    inlined_expression,
    read_record,
    with_fields,
    write_record,
)
from benchtool.physics.mixer import pitch_moment_Nm
from benchtool.physics.tilt import Plane, height_over
from benchtool.simulate.controllers.limits import clip
from benchtool.simulate.motors import Rotors, first_order_lag
from benchtool.simulate.noise import next_state, normal
from benchtool.simulate.pitch.records import Hinge, SensorReadings

SMALLEST = 1e-300  # keeps a hinge without friction from dividing nothing by nothing


@expression
def sine(angle_rad: Quantity) -> Quantity:
    """Return the sine, right to 5e-16 up to a quarter turn: Taylor's series to order 19."""
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
    """Return the cosine, right to 5e-16 up to a quarter turn: Taylor's series to order 20."""
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
    """Return the value in whole quanta; a zero quantum leaves it exactly alone."""
    step = np.maximum(quantum, 1e-12)
    return value + (quantum > 0.0) * (np.floor(value / step + 0.5) * step - value)


@expression
def read(true: Any, draw: Any, sensor: Any) -> Any:
    """Return a sensor's reading: bias and white noise on the true value, in whole quanta."""
    return rounded(true + sensor.bias + sensor.noise * draw, sensor.quantum)


@expression
def plane_below(plate_z_m: Any, theta_rad: Any, lean_rad: Any) -> Any:
    """Return where a plate lies whose centre is below the hinge and which leans by an angle."""
    return Plane(plate_z_m * cosine(lean_rad), -sine(theta_rad + lean_rad), 0.0)


@expression
def heights_over(plane: Any, x_m: Any, y_m: Any) -> Any:
    """Return the height of each disc over the plate: m."""
    found = x_m
    for i in range(len(x_m)):
        found = with_fields(found, i, height_over(plane, x_m[i], y_m[i]))
    return found


@expression
def scaled(values: Any, by: Any) -> Any:
    """Return each disc's value times a number."""
    found = values
    for i in range(len(values)):
        found = with_fields(found, i, values[i] * by)
    return found


@inlined_expression
def step_lane(w: Any, lane: Any, at: Any, states: Any, now: Any, to: Any, hooks: Any) -> None:
    """Advance the bench of one lane by one plant step; `to` says where its records stand."""
    discs, time_s = now.fixed, now.time_s
    body, motion = read_record(w, to.body, lane, at), read_record(w, to.motion, lane, at)
    hinge, rotors = read_record(w, to.hinge, lane, at), read_record(w, to.rotors, lane, at)
    plate = read_record(w, to.setpoint, lane, at)
    p = read_record(w, to.effects, lane, at)
    targets = read_record(w, to.targets, lane, at)
    old, new = targets.old_rad_s, targets.new_rad_s
    start_rad_s = rotors.speed_rad_s
    middle_rad_s = hooks.followed(
        start_rad_s, first_order_lag(motion.first, start_rad_s, old, new), p
    )
    end_rad_s = hooks.followed(
        middle_rad_s, first_order_lag(motion.second, middle_rad_s, old, new), p
    )
    write_record(w, to.rotors, lane, at, Rotors(end_rad_s))

    x, dt_s, rate = discs.x_m, discs.dt_s, hinge.rate_rad_s
    theta = hinge.theta_rad + 0.5 * dt_s * rate
    plane = plane_below(plate.plate_z_m, theta, hooks.tilt(p))
    heights = heights_over(plane, x, discs.y_m)
    areas = scaled(body.covered, plate.plate_share)
    speed = middle_rad_s
    for i in range(len(x)):
        speed = with_fields(speed, i, discs.roots[i] * middle_rad_s[i])
    flow = hooks.bare(
        body.radius_m, x, discs.y_m, plane, heights, areas, speed, time_s, theta, rate,
        cosine(theta), body.weight_N,
    )  # fmt: skip
    flow = hooks.with_images(flow, discs.distances_m, discs.body, p)
    factor = hooks.factors(flow, p)
    flow = hooks.with_thrust(flow, rate, body.k, factor)
    pushed = pitch_moment_Nm(flow.thrust_N, x) + hinge.wake_Nm
    share = body.step_over_inertia
    middle = rate + 0.5 * share * (pushed + hooks.torque(0, flow, p))
    flow = hooks.with_thrust(flow, middle, body.k, factor)
    slipping = rate + share * (pushed + hooks.torque(0, flow, p))
    held = share * hooks.dry_friction(0, flow, p)
    give = hooks.dry_give(0, flow, p) / dt_s
    built = held / np.maximum(give + held + hooks.dry_width(0, flow, p), SMALLEST)
    friction = clip((give * hinge.bent + slipping) * built, held)
    before, rate = rate, slipping - friction
    theta = theta + 0.5 * dt_s * rate
    inside = clip(theta, body.stop_rad)
    hit = 1.0 * (inside != theta)
    low = 0.0 * hit
    for i in range(len(x)):
        is_low = flow.height_m[i] <= hooks.nearest_z_over_R * body.radius_m
        low = np.maximum(low, is_low * (flow.coverage[i] > 0.0))
    first = next_state(states[lane])
    second = next_state(first)
    states[lane] = second
    wake = motion.wake_remains * hinge.wake_Nm + motion.wake_kick_Nm * normal(first, second)
    moved = Hinge(
        inside, (1.0 - hit) * rate, wake, friction / np.maximum(held, SMALLEST),
        hinge.clamped_steps + low, hinge.stopped_steps + hit, (rate - before) / dt_s,
    )  # fmt: skip
    write_record(w, to.hinge, lane, at, moved)


@inlined_expression
def sense_lane(
    w: Any, lane: Any, at: Any, states: Any, fresh: Any, time_s: Any, to: Any, hooks: Any
) -> None:
    """Read encoder, gyro, plate and rotor speeds of one lane; `fresh` says which have a reading."""
    before, late = read_record(w, to.readings, lane, at), read_record(w, to.delayed, lane, at)
    sensors, rotors = read_record(w, to.sensors, lane, at), read_record(w, to.rotors, lane, at)
    p = read_record(w, to.effects, lane, at)
    acceleration = read_record(w, to.hinge, lane, at).acceleration_rad_s2
    a = next_state(states[lane])
    b = next_state(a)
    theta = read(late.theta_rad, normal(a, b), sensors.theta)
    a = next_state(b)
    b = next_state(a)
    gyro = hooks.gyro(time_s, late.theta_rad, late.rate_rad_s, acceleration, p)
    gyro = read(gyro, normal(a, b), sensors.gyro)
    a = next_state(b)
    b = next_state(a)
    plate = read(late.plate_z_m, normal(a, b), sensors.plate)
    speeds = before.speed_rad_s
    for i in range(len(speeds)):
        a = next_state(b)
        b = next_state(a)
        speed = read(rotors.speed_rad_s[i], normal(a, b), sensors.speed)
        speeds = with_fields(speeds, i, speed if fresh.speed else before.speed_rad_s[i])
    states[lane] = b
    shown = SensorReadings(
        theta if fresh.theta else before.theta_rad,
        gyro if fresh.gyro else before.gyro_rad_s,
        plate if fresh.plate else before.plate_z_m,
        speeds,
    )
    write_record(w, to.readings, lane, at, shown)
