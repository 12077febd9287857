"""One lane's controller and mixer: from readings to whole pulses."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchtool.physics.expression import loop_part, read_record, replaced, write_record
from benchtool.physics.rotor import pwm_from_speed, speed_from_pwm, speed_from_thrust
from benchtool.physics.tilt import LEVEL
from benchtool.simulate.controllers.controller import PitchMeasurement, PitchReference
from benchtool.simulate.controllers.feedforward import compensated_thrust, expected_factor
from benchtool.simulate.motors import Targets
from benchtool.simulate.pitch.lane import heights_over, plane_below, rounded, scaled
from benchtool.simulate.pitch.records import Command


@loop_part
def control_lane(w: Any, lane: Any, at: Any, now: Any, to: Any, law: Any) -> None:
    """Run a built-in law of one lane: a controller's step, with its state in the lane's records."""
    seen, wanted = read_record(w, to.readings, lane, at), now.wanted.setpoint
    before = read_record(w, to.command, lane, at)
    state, command = law(
        read_record(w, to.law, lane, at),
        read_record(w, to.law_state, lane, at),
        PitchMeasurement(
            now.time_s, seen.theta_rad, seen.gyro_rad_s, seen.plate_z_m, seen.speed_rad_s
        ),
        PitchReference(wanted.reference_rad, wanted.collective_N, now.wanted.observer),
        now.plan.substeps * now.fixed.dt_s,
    )
    write_record(w, to.law_state, lane, at, state)
    asked = Command(command.torque_Nm, command.difference_us, before.factor, before.pwm_us)
    write_record(w, to.command, lane, at, asked)


@loop_part
def divide_lane(w: Any, lane: Any, at: Any, factor: Any, to: Any) -> None:
    """Write the factors by which the mixer of one lane divides thrusts."""
    asked = read_record(w, to.command, lane, at)
    divided = Command(asked.torque_Nm, asked.difference_us, factor, asked.pwm_us)
    write_record(w, to.command, lane, at, divided)


@loop_part
def drive_lane(w: Any, lane: Any, at: Any, now: Any, to: Any) -> None:
    """Write the setpoint of one lane, and the pulses of the schedule as its command."""
    write_record(w, to.setpoint, lane, at, now.wanted.setpoint)
    asked = read_record(w, to.command, lane, at)
    driven = Command(asked.torque_Nm, asked.difference_us, asked.factor, now.wanted.pwm_us)
    write_record(w, to.command, lane, at, driven)


@loop_part
def expect_lane(w: Any, lane: Any, at: Any, now: Any, to: Any, hooks: Any) -> None:
    """Work out the factors that the feedforward of one lane divides by."""
    nominal, wanted, discs = read_record(w, to.nominal, lane, at), now.wanted, now.fixed
    body, seen = read_record(w, to.body, lane, at), read_record(w, to.readings, lane, at)
    p = read_record(w, to.nominal_effects, lane, at)
    plane = plane_below(wanted.nominal_plate_z_m, seen.theta_rad, hooks.tilt(p))
    heights = heights_over(plane, discs.x_m, discs.y_m)
    areas = scaled(body.covered, wanted.nominal_share)
    flow = hooks.bare(
        nominal.radius_m, discs.x_m, discs.y_m, plane, heights, areas, heights, now.time_s,
        seen.theta_rad,
    )  # fmt: skip
    factor = hooks.factors(hooks.with_images(flow, discs.distances_m, discs.body, p), p)
    for i in range(len(factor)):
        factor = replaced(factor, i, expected_factor(factor[i], nominal.strength))
    divide_lane(w, lane, at, factor, to)


@loop_part
def mix_lane(w: Any, lane: Any, at: Any, now: Any, to: Any) -> None:
    """Write the setpoint of one lane, and share torque and collective out to its rotors, as whole
    pulses within limits.
    """
    write_record(w, to.setpoint, lane, at, now.wanted.setpoint)
    command, nominal = read_record(w, to.command, lane, at), read_record(w, to.nominal, lane, at)
    setpoint, limits = now.wanted.setpoint, read_record(w, to.limits, lane, at)
    x, pulses, pwm_us = now.fixed.x_m, nominal.pulses, command.pwm_us
    for i in range(len(x)):
        wanted = setpoint.collective_N - x[i] / now.fixed.span_m2 * command.torque_Nm
        asked = compensated_thrust(wanted, command.factor[i])
        speed = speed_from_thrust(asked, nominal.k)
        pwm = pwm_from_speed(speed, pulses.slope_rad_s_per_us, pulses.start_us, 1.0, 1.0)
        pwm = pwm - np.sign(x[i]) * (command.difference_us + now.wanted.dither_us)
        pwm = np.minimum(np.maximum(pwm, limits.least_us), limits.most_us)
        pwm_us = replaced(pwm_us, i, rounded(pwm, limits.quantum_us))
    mixed = Command(command.torque_Nm, command.difference_us, command.factor, pwm_us)
    write_record(w, to.command, lane, at, mixed)


@loop_part
def turn_lane(w: Any, lane: Any, at: Any, now: Any, to: Any, hooks: Any) -> None:
    """Turn the pulses of one lane into the speeds that its rotors will settle at."""
    discs, time_s = now.fixed, now.time_s
    command, pulses = read_record(w, to.command, lane, at), read_record(w, to.pulses, lane, at)
    targets, body = read_record(w, to.targets, lane, at), read_record(w, to.body, lane, at)
    slope, start, settled = pulses.slope_rad_s_per_us, pulses.start_us, targets.sent_rad_s
    for i in range(len(settled)):
        speed = speed_from_pwm(command.pwm_us[i], slope, start, 1.0, 1.0)
        settled = replaced(settled, i, speed)
    flow = hooks.bare(body.radius_m, discs.x_m, discs.y_m, LEVEL, settled, settled, settled, time_s)
    given = hooks.speeds(flow, read_record(w, to.effects, lane, at))
    write_record(w, to.targets, lane, at, Targets(given, given, given))
