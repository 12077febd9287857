"""One lane's controller and mixer: from readings to whole pulses."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchtool.physics.expression import loop_part
from benchtool.physics.rotor import pwm_from_speed, speed_from_pwm, speed_from_thrust
from benchtool.simulate.controllers.feedforward import compensated_thrust, expected_factor
from benchtool.simulate.controllers.limits import limited
from benchtool.simulate.controllers.observer import next_explained, observed
from benchtool.simulate.controllers.pid import (
    AttitudePid,
    PidState,
    attitude_torque,
    next_pid_state,
)
from benchtool.simulate.pitch import rows as r
from benchtool.simulate.pitch.lane import rounded
from benchtool.simulate.trigonometry import sine


@loop_part
def control_lane(w: Any, lane: Any, at: Any, observing: Any, dt_s: Any) -> None:
    """Run the built-in controller of one lane: two-loop PID, observer, and the pulse law."""
    reference, theta = w[r.REFERENCE * at + lane], w[r.READ_THETA * at + lane]
    rate = w[r.READ_GYRO * at + lane]
    p = AttitudePid(
        w[r.PID * at + lane],
        w[(r.PID + 1) * at + lane],
        w[(r.PID + 2) * at + lane],
        w[(r.PID + 3) * at + lane],
        w[(r.PID + 4) * at + lane],
        w[(r.PID + 5) * at + lane],
        w[(r.PID + 6) * at + lane],
        w[(r.PID + 7) * at + lane],
        w[(r.PID + 8) * at + lane],
    )
    state = PidState(w[r.RATE_INTEGRAL * at + lane], w[r.ACCELERATION_INTEGRAL * at + lane])
    momentum = p.inertia_kgm2 * rate
    explained = w[r.EXPLAINED * at + lane]
    estimate = observing * observed(momentum, explained, w[r.OBSERVER_RATE * at + lane])
    asked = attitude_torque(reference, theta, rate, state, p) - estimate
    torque = limited(asked, p.torque_limit_Nm)
    following = next_pid_state(reference, theta, rate, state, p, dt_s)
    w[r.RATE_INTEGRAL * at + lane] = following.rate_rad_s
    w[r.ACCELERATION_INTEGRAL * at + lane] = following.acceleration_rad_s2
    w[r.EXPLAINED * at + lane] = next_explained(
        momentum, explained, torque, estimate, observing, dt_s
    )
    w[r.ESTIMATE * at + lane] = estimate
    w[r.TORQUE * at + lane] = torque
    error = reference - theta
    total = limited(w[r.ERROR_INTEGRAL * at + lane] + error * dt_s, w[r.PULSE_LIMIT * at + lane])
    w[r.ERROR_INTEGRAL * at + lane] = total
    w[r.DIFFERENCE * at + lane] = (
        w[r.PULSE_KP * at + lane] * error
        + w[r.PULSE_KI * at + lane] * total
        - w[r.PULSE_KD * at + lane] * rate
    )


@loop_part
def expect_lane(w: Any, lane: Any, at: Any, now: Any, shared: Any, hooks: Any) -> None:
    """Work out the factors that the feedforward of one lane divides by."""
    x = shared.x
    gap, share = now
    p = hooks.numbers(w, r.EFFECTS + len(hooks.numbers(w, r.EFFECTS, lane, at)), lane, at)
    theta = w[r.READ_THETA * at + lane]
    for i in range(len(x)):
        w[(r.AREA + i) * at + lane] = w[(r.COVERED + i) * at + lane] * share
    heights = hooks.gaps(gap, x, sine(theta))
    areas = hooks.of_discs(w, r.AREA, lane, at)
    flow = hooks.bare(
        w[r.BELIEVED_RADIUS * at + lane],
        x,
        shared.y,
        heights,
        areas,
        heights,
        shared.time_s,
        theta,
        0.0,
        1.0,
        0.0,
    )
    factor = hooks.factors(hooks.blown(flow, shared.distances, shared.arms, p), p)
    for i in range(len(x)):
        w[(r.FACTOR + i) * at + lane] = expected_factor(factor[i], w[r.STRENGTH * at + lane])


@loop_part
def mix_lane(w: Any, lane: Any, at: Any, dither: Any, span: Any, x: Any) -> None:
    """Share torque and collective out to the rotors of one lane, as whole pulses within limits."""
    slope, start = w[r.BELIEVED_SLOPE * at + lane], w[r.BELIEVED_START * at + lane]
    for i in range(len(x)):
        wanted = w[r.COLLECTIVE * at + lane] - x[i] / span * w[r.TORQUE * at + lane]
        asked = compensated_thrust(wanted, w[(r.FACTOR + i) * at + lane])
        speed = speed_from_thrust(asked, w[r.BELIEVED_K * at + lane])
        pwm = pwm_from_speed(speed, slope, start, 1.0, 1.0)
        pwm = pwm - np.sign(x[i]) * (w[r.DIFFERENCE * at + lane] + dither)
        pwm = np.minimum(np.maximum(pwm, w[r.PWM_MIN * at + lane]), w[r.PWM_MAX * at + lane])
        w[(r.PWM + i) * at + lane] = rounded(pwm, w[r.PWM_QUANTUM * at + lane])


@loop_part
def turn_lane(w: Any, lane: Any, at: Any, shared: Any, hooks: Any) -> None:
    """Turn the pulses of one lane into the speeds that its rotors will settle at."""
    x, time_s = shared.x, shared.time_s
    slope, start = w[r.SLOPE * at + lane], w[r.START * at + lane]
    for i in range(len(x)):
        pwm = w[(r.PWM + i) * at + lane]
        w[(r.TARGET + i) * at + lane] = speed_from_pwm(pwm, slope, start, 1.0, 1.0)
    target = hooks.of_discs(w, r.TARGET, lane, at)
    radius = w[r.RADIUS * at + lane]
    flow = hooks.bare(radius, x, shared.y, target, target, target, time_s, 0.0, 0.0, 1.0, 0.0)
    given = hooks.speeds(flow, hooks.numbers(w, r.EFFECTS, lane, at))
    for i in range(len(x)):
        w[(r.TARGET + i) * at + lane] = given[i]
