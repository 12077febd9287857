"""The built-in flight law: position, velocity, attitude and rate in a cascade; an observer.

The same laws on both horizontal axes, height and three attitude angles. The observer watches all
six components and compensates the torques, as the paper's controller does. The feedforward, which
divides each rotor's thrust by the factor that a map gives, is the loop's.
"""

from __future__ import annotations

import math
from collections import namedtuple
from typing import Any, NamedTuple

import numpy as np

from benchtool.core.rig import Body
from benchtool.physics.expression import Quantity, expression, inlined_expression
from benchtool.physics.fold import unrolled
from benchtool.simulate.controllers.controller import ControlLaw, FlightCommand
from benchtool.simulate.controllers.limits import clip, integrate_clamped, limit_slew_rate
from benchtool.simulate.controllers.observer import next_disturbance_estimate, update_observer
from benchtool.simulate.controllers.pid import (
    AttitudePid,
    PidState,
    attitude_torque,
    next_pid_state,
)
from benchtool.simulate.flight.rigid_body import GRAVITY_M_S2
from benchtool.simulate.gain_file import Gains

FREE_M_S = 3.0  # speed limit while a ramp leads, so that the ramp sets the pace; assumed

FlightNumbers = namedtuple(
    "FlightNumbers",
    "position roll pitch yaw k_z_per_s2 k_vz_per_s k_iz_per_s3 climb_limit_m_s2 observer_per_s "
    "compensate from_s ramp mass_kg gravity_m_s2",
)
"""Numbers of the law: loops, the observer's bandwidth and start `from_s`; `compensate` is 1 to
subtract the observed torque, `ramp` 1 where the reference leads along in place of a speed limit.
"""

Wrench = namedtuple(  # force in world axes (N) and torque in body axes (N m), or their momenta
    "Wrench",
    "force_x_N force_y_N force_z_N roll_Nm pitch_Nm yaw_Nm",
    defaults=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
)

HorizontalState = namedtuple("HorizontalState", "velocity_m_s integral_m_s2", defaults=(0.0, 0.0))
"""Of one horizontal axis: velocity command (m/s) and velocity integral (m/s2)."""

Attitude = namedtuple("Attitude", "roll_rad pitch_rad yaw_rad", defaults=(0.0, 0.0, 0.0))
"""Angles, or what is commanded of them: rad."""

STILL = PidState(0.0, 0.0)


class PositionLoop(NamedTuple):
    """Hold the numbers of the position loop; fields as in `library.PositionGains`."""

    k_x_per_s: Quantity
    k_v_per_s: Quantity
    k_iv_per_s2: Quantity
    integral_limit_m_s2: Quantity
    slew_limit_m_s2: Quantity
    pitch_limit_rad: Quantity


@expression
def velocity_command(
    error_m: Quantity,
    present_m_s: Quantity,
    speed_limit_m_s: Quantity,
    p: PositionLoop,
    dt_s: Quantity,
) -> Quantity:
    """Return the next velocity command: k_x times the error, limited, slewed: m/s."""
    wanted = clip(p.k_x_per_s * error_m, speed_limit_m_s)
    return limit_slew_rate(wanted, present_m_s, p.slew_limit_m_s2, dt_s)


@expression
def next_velocity_integral(
    velocity_error_m_s: Quantity, integral_m_s2: Quantity, p: PositionLoop, dt_s: Quantity
) -> Quantity:
    """Return the velocity integral one period on, held at its limit: m/s2."""
    return integrate_clamped(
        integral_m_s2, p.k_iv_per_s2 * velocity_error_m_s, p.integral_limit_m_s2, dt_s
    )


@expression
def acceleration_command(
    velocity_error_m_s: Quantity, integral_m_s2: Quantity, p: PositionLoop
) -> Quantity:
    """Return the horizontal acceleration to ask for: m/s2."""
    return p.k_v_per_s * velocity_error_m_s + integral_m_s2


@expression
def pitch_command(acceleration_m_s2: Quantity, gravity_m_s2: Quantity, p: PositionLoop) -> Quantity:
    """Return the pitch that gives an acceleration at hover, a/g, limited: rad, nose down."""
    return clip(acceleration_m_s2 / gravity_m_s2, p.pitch_limit_rad)


@expression
def climb_command(
    error_m: Quantity,
    velocity_m_s: Quantity,
    integral_m_s2: Quantity,
    k_z_per_s2: Quantity,
    k_vz_per_s: Quantity,
    limit_m_s2: Quantity,
) -> Quantity:
    """Return the vertical acceleration to ask for: a PD law plus its integral part: m/s2."""
    return clip(k_z_per_s2 * error_m - k_vz_per_s * velocity_m_s + integral_m_s2, limit_m_s2)


@expression
def lifting_thrust(
    climb_m_s2: Quantity, mass_kg: Quantity, gravity_m_s2: Quantity, cos_tilt: Quantity
) -> Quantity:
    """Return the total thrust for a vertical acceleration at a tilt: N."""
    return mass_kg * (gravity_m_s2 + climb_m_s2) / np.maximum(cos_tilt, 0.5)


FlightLawState = namedtuple(
    "FlightLawState",
    "x y climb_m_s2 roll pitch yaw explained estimate attitude",
    defaults=(
        HorizontalState(), HorizontalState(), 0.0, STILL, STILL, STILL, Wrench(), Wrench(),
        Attitude(),
    ),
)  # fmt: skip
"""Horizontal axes, climb integral (m/s2), integrals of the attitude loops, momentum that the
observer explained, estimate, and attitude commanded last.
"""


@expression
def _estimate(c: int, momentum: Any, explained: Any, rate_per_s: Any, on: Any) -> Any:
    return on * update_observer(momentum[c], explained[c], rate_per_s)


@expression
def _explained(
    c: int, momentum: Any, before: Any, known: Any, estimate: Any, on: Any, dt_s: Any
) -> Any:
    return next_disturbance_estimate(momentum[c], before[c], known[c], estimate[c], on, dt_s)


_estimates, _explained_next = unrolled(6, _estimate), unrolled(6, _explained)


@inlined_expression
def _wanted_acceleration(
    error_m: Any, limit_m_s: Any, velocity_m_s: Any, before: Any, p: PositionLoop, dt_s: Any
) -> Any:
    """Return the state of one horizontal axis and the acceleration that it asks for."""
    command = velocity_command(error_m, before.velocity_m_s, limit_m_s, p, dt_s)
    error = command - velocity_m_s
    integral = next_velocity_integral(error, before.integral_m_s2, p, dt_s)
    return HorizontalState(command, integral), acceleration_command(error, integral, p)


@inlined_expression
def _attitude(
    wanted: Any, angle: Any, rate: Any, before: PidState, pid: AttitudePid, dt_s: Any
) -> Any:
    """Return the state of one attitude loop and the torque that it asks for."""
    after = next_pid_state(wanted, angle, rate, before, pid, dt_s)
    return after, attitude_torque(wanted, angle, rate, after, pid)


@inlined_expression
def flight_step(
    p: FlightNumbers, state: FlightLawState, measured: Any, reference: Any, dt_s: Any
) -> Any:
    """Return state and command of the control period that begins now."""
    roll, pitch, yaw = measured.roll_rad, measured.pitch_rad, measured.yaw_rad
    ex, ey = reference.x_m - measured.x_m, reference.y_m - measured.y_m
    away_m = math.sqrt(ex * ex + ey * ey)
    limit = reference.speed_m_s if p.ramp == 0.0 else FREE_M_S
    limit_x, limit_y = limit, limit
    if away_m > 0.0:
        limit_x, limit_y = limit * abs(ex) / away_m, limit * abs(ey) / away_m
    x, ax = _wanted_acceleration(ex, limit_x, measured.vx_m_s, state.x, p.position, dt_s)
    y, ay = _wanted_acceleration(ey, limit_y, measured.vy_m_s, state.y, p.position, dt_s)
    cosine, sine = math.cos(yaw), math.sin(yaw)
    forward, left = cosine * ax + sine * ay, cosine * ay - sine * ax
    pitch_wanted = pitch_command(forward, p.gravity_m_s2, p.position)
    roll_wanted = -pitch_command(left, p.gravity_m_s2, p.position)
    turn = reference.yaw_rad - yaw
    turn -= 2.0 * math.pi * math.floor(turn / (2.0 * math.pi) + 0.5)
    wanted = Attitude(roll_wanted, pitch_wanted, yaw + turn)
    roll_rate, pitch_rate, yaw_rate = measured.p_rad_s, measured.q_rad_s, measured.r_rad_s
    roll_loop, asked_x = _attitude(wanted.roll_rad, roll, roll_rate, state.roll, p.roll, dt_s)
    pitch_loop, asked_y = _attitude(wanted.pitch_rad, pitch, pitch_rate, state.pitch, p.pitch, dt_s)
    yaw_loop, asked_z = _attitude(wanted.yaw_rad, yaw, yaw_rate, state.yaw, p.yaw, dt_s)
    ez = reference.z_m - measured.z_m
    climb_integral = integrate_clamped(state.climb_m_s2, p.k_iz_per_s3 * ez, np.inf, dt_s)
    climb = climb_command(
        ez, measured.vz_m_s, climb_integral, p.k_z_per_s2, p.k_vz_per_s, p.climb_limit_m_s2
    )
    cos_roll, cos_pitch = math.cos(roll), math.cos(pitch)
    thrust = lifting_thrust(climb, p.mass_kg, p.gravity_m_s2, cos_pitch * cos_roll)

    on = 1.0 if p.observer_per_s > 0.0 and measured.time_s >= p.from_s else 0.0
    jx, jy, jz = p.roll.inertia_kgm2, p.pitch.inertia_kgm2, p.yaw.inertia_kgm2
    momentum = (
        p.mass_kg * measured.vx_m_s, p.mass_kg * measured.vy_m_s, p.mass_kg * measured.vz_m_s,
        jx * roll_rate, jy * pitch_rate, jz * yaw_rate,
    )  # fmt: skip
    estimate = Wrench(*_estimates(momentum, state.explained, p.observer_per_s, on))
    undone = on * p.compensate
    tx = asked_x - undone * estimate.roll_Nm
    ty = asked_y - undone * estimate.pitch_Nm
    tz = asked_z - undone * estimate.yaw_Nm
    sin_roll, sin_pitch = math.sin(roll), math.sin(pitch)
    known = (
        thrust * (cosine * sin_pitch * cos_roll + sine * sin_roll),
        thrust * (sine * sin_pitch * cos_roll - cosine * sin_roll),
        thrust * cos_pitch * cos_roll - p.mass_kg * p.gravity_m_s2,
        tx + (jy - jz) * pitch_rate * yaw_rate,
        ty + (jz - jx) * yaw_rate * roll_rate,
        tz + (jx - jy) * roll_rate * pitch_rate,
    )
    explained = _explained_next(momentum, state.explained, known, estimate, on, dt_s)
    after = FlightLawState(
        x, y, climb_integral, roll_loop, pitch_loop, yaw_loop, Wrench(*explained), estimate, wanted
    )
    return after, FlightCommand(thrust, tx, ty, tz, ())


def flight_numbers(case: Any, body: Body) -> FlightNumbers:
    """Return the law's numbers for a `FlightCase` and the body as it is known."""
    gains: Gains = case.gains
    a, y, p = gains.attitude, gains.yaw, gains.position

    def tilt(inertia_kgm2: float) -> AttitudePid:
        return AttitudePid(
            a.k_theta_per_s,
            a.k_i_theta_per_s2,
            a.theta_integral_limit_rad_s,
            a.rate_limit_rad_s,
            a.k_q_per_s,
            a.k_i_q_per_s2,
            a.q_integral_limit_rad_s2,
            inertia_kgm2,
            math.inf,
        )

    heading = AttitudePid(
        y.k_psi_per_s, 0.0, 1.0, a.rate_limit_rad_s, y.k_r_per_s, 0.0, 1.0,
        body.inertia_zz_kgm2, math.inf,
    )  # fmt: skip
    return FlightNumbers(
        PositionLoop(
            p.k_x_per_s,
            p.k_v_per_s,
            p.k_iv_per_s2,
            p.integral_limit_m_s2,
            p.slew_limit_m_s2,
            p.pitch_limit_rad,
        ),
        tilt(body.inertia_xx_kgm2),
        tilt(body.inertia_yy_kgm2),
        heading,
        gains.altitude.k_z_per_s2,
        gains.altitude.k_vz_per_s,
        gains.altitude.k_iz_per_s3,
        gains.altitude.limit_m_s2,
        gains.observer.rate_per_s,
        float(case.observes),
        case.compensation_from_s,
        float(case.ramp),
        body.mass_kg,
        GRAVITY_M_S2,
    )


LAW = ControlLaw(
    name="pid",
    title="PID",
    body="free",
    step=flight_step,
    state=FlightLawState(),
    numbers=flight_numbers,
)
