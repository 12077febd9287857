"""One lane's hinge, rotors and sensors; every function works on column `lane` of the work space.

`w` is the work space, flat: row times the number of lanes (`at`) plus lane. The hinge is
integrated by the midpoint rule with an implicit step for dry friction: second order while it
slips, exactly at rest while it sticks. Rotor speeds follow their lag exactly, also where a delayed
command arrives in the middle of a step.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from benchtool.physics.expression import expression, loop_part
from benchtool.physics.mixer import pitch_moment_Nm
from benchtool.simulate.controllers.limits import limited
from benchtool.simulate.noise import next_state, normal
from benchtool.simulate.pitch import rows as r
from benchtool.simulate.trigonometry import cosine, sine

SMALLEST = 1e-300
"""Keeps a hinge without friction from dividing nothing by nothing."""


@expression
def rounded(value: Any, quantum: Any) -> Any:
    """Return the value in whole quanta; a zero quantum leaves it exactly alone."""
    step = np.maximum(quantum, 1e-12)
    return value + (quantum > 0.0) * (np.floor(value / step + 0.5) * step - value)


@expression
def read(true: Any, draw: Any, w: Any, sensor: Any, at: Any, lane: Any) -> Any:
    """Return a sensor's reading: bias and white noise on the true value, in whole quanta."""
    raw = true + w[sensor[1] * at + lane] + w[sensor[0] * at + lane] * draw
    return rounded(raw, w[sensor[2] * at + lane])


@loop_part
def step_lane(w: Any, lane: Any, at: Any, states: Any, shared: Any, hooks: Any) -> None:
    """Advance the bench of one lane by one plant step; `shared` is what all lanes share."""
    x, dt_s, time_s = shared.x, shared.dt_s, shared.time_s
    for i in range(len(x)):
        w[(r.SPEED + i) * at + lane] = (
            w[r.MID_KEPT * at + lane] * w[(r.SPEED + i) * at + lane]
            + w[r.MID_OLD * at + lane] * w[(r.OLD + i) * at + lane]
            + w[r.MID_NEW * at + lane] * w[(r.NEW + i) * at + lane]
        )
        w[(r.DISC_SPEED + i) * at + lane] = shared.roots[i] * w[(r.SPEED + i) * at + lane]
        w[(r.SPEED + i) * at + lane] = (
            w[r.END_KEPT * at + lane] * w[(r.SPEED + i) * at + lane]
            + w[r.END_OLD * at + lane] * w[(r.OLD + i) * at + lane]
            + w[r.END_NEW * at + lane] * w[(r.NEW + i) * at + lane]
        )
        w[(r.AREA + i) * at + lane] = w[(r.COVERED + i) * at + lane] * w[r.SHARE * at + lane]
    p = hooks.numbers(w, r.EFFECTS, lane, at)
    rate = w[r.RATE * at + lane]
    theta = w[r.THETA * at + lane] + 0.5 * dt_s * rate
    radius, weight, k = w[r.RADIUS * at + lane], w[r.WEIGHT * at + lane], w[r.K * at + lane]
    heights = hooks.gaps(w[r.PLATE * at + lane], x, sine(theta))
    areas = hooks.of_discs(w, r.AREA, lane, at)
    speed = hooks.of_discs(w, r.DISC_SPEED, lane, at)
    flow = hooks.bare(
        radius, x, shared.y, heights, areas, speed, time_s, theta, rate, cosine(theta), weight
    )
    flow = hooks.blown(flow, shared.distances, shared.arms, p)
    factor = hooks.factors(flow, p)
    flow = hooks.loaded(flow, rate, k, factor)
    pushed = pitch_moment_Nm(flow.thrust_N, x) + w[r.WAKE * at + lane]
    share = dt_s / w[r.INERTIA * at + lane]
    middle = rate + 0.5 * share * (pushed + hooks.torque(flow, p))
    flow = hooks.loaded(flow, middle, k, factor)
    slipping = rate + share * (pushed + hooks.torque(flow, p))
    held = share * hooks.dry_friction(flow, p)
    built = held / np.maximum(held + hooks.dry_width(flow, p), SMALLEST)
    rate = slipping - limited(slipping * built, held)
    theta = theta + 0.5 * dt_s * rate
    inside = limited(theta, w[r.STOP * at + lane])
    hit = 1.0 * (inside != theta)
    w[r.THETA * at + lane] = inside
    w[r.RATE * at + lane] = (1.0 - hit) * rate
    w[r.STOPPED * at + lane] = w[r.STOPPED * at + lane] + hit
    low = 0.0 * hit
    for i in range(len(x)):
        low = np.maximum(low, (flow.height_m[i] <= 0.5 * radius) * (flow.coverage[i] > 0.0))
    w[r.CLAMPED * at + lane] = w[r.CLAMPED * at + lane] + low
    first = next_state(states[lane])
    second = next_state(first)
    states[lane] = second
    w[r.WAKE * at + lane] = w[r.WAKE_KEPT * at + lane] * w[r.WAKE * at + lane] + w[
        r.WAKE_KICK * at + lane
    ] * normal(first, second)


@loop_part
def arrive_lane(
    w: Any, lane: Any, at: Any, sent: Any, step: Any, substeps: Any, ring: Any, n: Any
) -> None:
    """Look up which commands are in force at the two ends of a plant step, after the delay."""
    late = step - int(w[r.DELAY_STEPS * at + lane])
    old, new = ((late - 1) // substeps) % ring, (late // substeps) % ring
    for i in range(len(n)):
        w[(r.OLD + i) * at + lane] = sent[(i * ring + old) * at + lane]
        w[(r.NEW + i) * at + lane] = sent[(i * ring + new) * at + lane]


@loop_part
def sense_lane(
    w: Any, lane: Any, at: Any, states: Any, new: Any, hooks: Any, flow: Any, n: Any
) -> None:
    """Read encoder, gyro, plate and rotor speeds of one lane; `new` says which have a reading."""
    p = hooks.numbers(w, r.EFFECTS, lane, at)
    a = next_state(states[lane])
    b = next_state(a)
    theta = read(w[r.SEEN_THETA * at + lane], normal(a, b), w, r.THETA_SENSOR, at, lane)
    a = next_state(b)
    b = next_state(a)
    turning = hooks.gyro(w[r.SEEN_RATE * at + lane], flow, p)
    gyro = read(turning, normal(a, b), w, r.GYRO_SENSOR, at, lane)
    a = next_state(b)
    b = next_state(a)
    plate = read(w[r.SEEN_PLATE * at + lane], normal(a, b), w, r.PLATE_SENSOR, at, lane)
    w[r.READ_THETA * at + lane] = theta if new[r.F_THETA] else w[r.READ_THETA * at + lane]
    w[r.READ_GYRO * at + lane] = gyro if new[r.F_GYRO] else w[r.READ_GYRO * at + lane]
    w[r.READ_PLATE * at + lane] = plate if new[r.F_PLATE] else w[r.READ_PLATE * at + lane]
    for i in range(len(n)):
        a = next_state(b)
        b = next_state(a)
        speed = read(w[(r.SPEED + i) * at + lane], normal(a, b), w, r.SPEED_SENSOR, at, lane)
        held = w[(r.READ_SPEED + i) * at + lane]
        w[(r.READ_SPEED + i) * at + lane] = speed if new[r.F_SPEED] else held
    states[lane] = b
