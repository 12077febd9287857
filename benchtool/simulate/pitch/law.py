"""One lane's controller and mixer: from readings to whole pulses."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchtool.physics.expression import loop_part, read_record, replaced, write_record
from benchtool.physics.rotor import pwm_from_speed, speed_from_pwm, speed_from_thrust
from benchtool.simulate.controllers.controller import PitchMeasurement, PitchReference
from benchtool.simulate.controllers.feedforward import compensated_thrust, expected_factor
from benchtool.simulate.motors import Targets
from benchtool.simulate.pitch.lane import heights_over, rounded, scaled
from benchtool.simulate.pitch.records import Command


@loop_part
def control_lane(
    w: Any, lane: Any, at: Any, time_s: Any, observer: Any, dt_s: Any, to: Any, law: Any
) -> None:
    """Run a built-in law of one lane: a controller's step, with its state in the lane's records."""
    seen, wanted = read_record(w, to.readings, lane, at), read_record(w, to.setpoint, lane, at)
    before = read_record(w, to.command, lane, at)
    state, command = law(
        read_record(w, to.law, lane, at),
        read_record(w, to.law_state, lane, at),
        PitchMeasurement(time_s, seen.theta_rad, seen.gyro_rad_s, seen.plate_z_m, seen.speed_rad_s),
        PitchReference(wanted.reference_rad, wanted.collective_N, observer),
        dt_s,
    )
    write_record(w, to.law_state, lane, at, state)
    asked = Command(command.torque_Nm, command.difference_us, before.factor, before.pwm_us)
    write_record(w, to.command, lane, at, asked)


@loop_part
def expect_lane(
    w: Any, lane: Any, at: Any, now: Any, time_s: Any, discs: Any, to: Any, hooks: Any
) -> None:
    """Work out the factors that the feedforward of one lane divides by; 1 while it is off."""
    command, nominal = read_record(w, to.command, lane, at), read_record(w, to.nominal, lane, at)
    body, seen = read_record(w, to.body, lane, at), read_record(w, to.readings, lane, at)
    p = read_record(w, to.nominal_effects, lane, at)
    heights = heights_over(now.nominal_plate_z_m, discs.x_m, seen.theta_rad)
    areas = scaled(body.covered, now.nominal_share)
    flow = hooks.bare(
        nominal.radius_m, discs.x_m, discs.y_m, heights, areas, heights, time_s, seen.theta_rad,
        0.0, 1.0, 0.0,
    )  # fmt: skip
    factor = hooks.factors(hooks.with_images(flow, discs.distances_m, discs.arms_m, p), p)
    for i in range(len(factor)):
        factor = replaced(factor, i, expected_factor(factor[i], nominal.strength))
    divided = Command(command.torque_Nm, command.difference_us, factor, command.pwm_us)
    write_record(w, to.command, lane, at, divided)


@loop_part
def mix_lane(w: Any, lane: Any, at: Any, now: Any, span: Any, discs: Any, to: Any) -> None:
    """Share torque and collective out to the rotors of one lane, as whole pulses within limits."""
    command, nominal = read_record(w, to.command, lane, at), read_record(w, to.nominal, lane, at)
    setpoint, limits = read_record(w, to.setpoint, lane, at), read_record(w, to.limits, lane, at)
    x, pulses, pwm_us = discs.x_m, nominal.pulses, command.pwm_us
    for i in range(len(x)):
        wanted = setpoint.collective_N - x[i] / span * command.torque_Nm
        asked = compensated_thrust(wanted, command.factor[i])
        speed = speed_from_thrust(asked, nominal.k)
        pwm = pwm_from_speed(speed, pulses.slope_rad_s_per_us, pulses.start_us, 1.0, 1.0)
        pwm = pwm - np.sign(x[i]) * (command.difference_us + now.dither_us)
        pwm = np.minimum(np.maximum(pwm, limits.least_us), limits.most_us)
        pwm_us = replaced(pwm_us, i, rounded(pwm, limits.quantum_us))
    mixed = Command(command.torque_Nm, command.difference_us, command.factor, pwm_us)
    write_record(w, to.command, lane, at, mixed)


@loop_part
def turn_lane(w: Any, lane: Any, at: Any, time_s: Any, discs: Any, to: Any, hooks: Any) -> None:
    """Turn the pulses of one lane into the speeds that its rotors will settle at."""
    command, pulses = read_record(w, to.command, lane, at), read_record(w, to.pulses, lane, at)
    targets, body = read_record(w, to.targets, lane, at), read_record(w, to.body, lane, at)
    slope, start, settled = pulses.slope_rad_s_per_us, pulses.start_us, targets.sent_rad_s
    for i in range(len(settled)):
        speed = speed_from_pwm(command.pwm_us[i], slope, start, 1.0, 1.0)
        settled = replaced(settled, i, speed)
    flow = hooks.bare(
        body.radius_m, discs.x_m, discs.y_m, settled, settled, settled, time_s, 0.0, 0.0, 1.0, 0.0
    )
    given = hooks.speeds(flow, read_record(w, to.effects, lane, at))
    write_record(w, to.targets, lane, at, Targets(given, given, given))
