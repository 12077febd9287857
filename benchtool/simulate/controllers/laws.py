"""Built-in controllers by name, and the flight law; the pitch law is in `pitch`.

The flight law is a cascade of position, velocity, attitude and rate, with an observer. Both
horizontal axes have the same law, and so do the attitude angles. The observer estimates all six
components and compensates the torques, as in the paper. The feedforward, which divides each
rotor's thrust by the factor from a map, is part of the loop.
"""

from __future__ import annotations

import math
from collections import namedtuple
from typing import Any, NamedTuple

import numpy as np

from benchtool.core.errors import UnknownChoice
from benchtool.core.rig import Body
from benchtool.physics.expression import Quantity, at_least, expression, inlined_expression
from benchtool.physics.fold import unrolled
from benchtool.simulate.controllers import pitch
from benchtool.simulate.controllers.blocks import (
    AttitudePid,
    PidState,
    attitude_torque,
    clip,
    estimate_disturbance,
    integrate_clamped,
    limit_slew_rate,
    next_explained_momentum,
    next_pid_state,
)
from benchtool.simulate.controllers.controller import GRAVITY_M_S2, ControlLaw, FlightCommand
from benchtool.simulate.controllers.pitch import Feedforward, PitchControl
from benchtool.simulate.gain_file import Gains

RAMP_MAX_SPEED_M_S = 3.0  # speed limit with a ramp: the ramp sets the speed; assumed

# Numbers of the law: loops, bandwidth and start of the observer; `compensate` is 1 to subtract the
# estimated torque, `ramp` 1 where a moving reference replaces the speed limit.
FlightNumbers = namedtuple(
    "FlightNumbers",
    "position roll pitch yaw k_z_per_s2 k_vz_per_s k_iz_per_s3 climb_limit_m_s2 observer_per_s "
    "compensate from_s ramp mass_kg gravity_m_s2",
)

Wrench = namedtuple(  # force in world axes (N) and torque in body axes (N m), or their momenta
    "Wrench",
    "force_x_N force_y_N force_z_N roll_Nm pitch_Nm yaw_Nm",
    defaults=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
)

# One horizontal axis: velocity command and velocity integral.
HorizontalState = namedtuple("HorizontalState", "velocity_m_s integral_m_s2", defaults=(0.0, 0.0))

# Angles or commanded angles.
Attitude = namedtuple("Attitude", "roll_rad pitch_rad yaw_rad", defaults=(0.0, 0.0, 0.0))

ZERO_PID = PidState(0.0, 0.0)


class PositionLoop(NamedTuple):
    """Numbers of the position loop; fields as in `gain_file.PositionGains`."""

    k_x_per_s: Quantity
    k_v_per_s: Quantity
    k_iv_per_s2: Quantity
    integral_limit_m_s2: Quantity
    slew_limit_m_s2: Quantity
    pitch_limit_rad: Quantity


@expression
def velocity_command(
    error_m: Quantity, present_m_s: Quantity, limit_m_s: Quantity, p: PositionLoop, dt_s: Quantity
) -> Quantity:
    """Return the next velocity command: k_x times the error, clipped and rate limited: m/s."""
    requested_m_s = clip(p.k_x_per_s * error_m, limit_m_s)
    return limit_slew_rate(requested_m_s, present_m_s, p.slew_limit_m_s2, dt_s)


@expression
def pitch_command(acceleration_m_s2: Quantity, gravity_m_s2: Quantity, p: PositionLoop) -> Quantity:
    """Return the pitch for an acceleration at hover, a/g, clipped: rad, nose down."""
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
    """Return the vertical acceleration command: a PD law plus its integral part: m/s2."""
    return clip(k_z_per_s2 * error_m - k_vz_per_s * velocity_m_s + integral_m_s2, limit_m_s2)


@expression
def lifting_thrust(
    climb_m_s2: Quantity, mass_kg: Quantity, gravity_m_s2: Quantity, cos_tilt: Quantity
) -> Quantity:
    """Return the total thrust for a vertical acceleration at a tilt: N."""
    return mass_kg * (gravity_m_s2 + climb_m_s2) / at_least(cos_tilt, 0.5)


# Horizontal axes, climb integral (m/s2), integrals of the attitude loops, momentum explained by the
# observer, its estimate, and the last attitude command.
FlightLawState = namedtuple(
    "FlightLawState",
    "x y climb_m_s2 roll pitch yaw explained estimate attitude",
    defaults=(
        HorizontalState(), HorizontalState(), 0.0, ZERO_PID, ZERO_PID, ZERO_PID, Wrench(), Wrench(),
        Attitude(),
    ),
)  # fmt: skip


@expression
def _estimate(i: int, momentum: Any, explained: Any, rate_per_s: Any, enabled: Any) -> Any:
    return enabled * estimate_disturbance(momentum[i], explained[i], rate_per_s)


@expression
def _explain(i: int, parts: Any, enabled: Any, dt_s: Any) -> Any:
    momentum, explained, force, estimate = parts
    return next_explained_momentum(momentum[i], explained[i], force[i], estimate[i], enabled, dt_s)


_estimate_all, _explain_all = unrolled(6, _estimate), unrolled(6, _explain)


@inlined_expression
def horizontal_step(
    error_m: Any, speed_limit_m_s: Any, velocity_m_s: Any, axis: Any, p: PositionLoop, dt_s: Any
) -> Any:
    """Return the next state of one horizontal axis and its acceleration command (m/s2)."""
    command = velocity_command(error_m, axis.velocity_m_s, speed_limit_m_s, p, dt_s)
    error = command - velocity_m_s
    integral = integrate_clamped(
        axis.integral_m_s2, p.k_iv_per_s2 * error, p.integral_limit_m_s2, dt_s
    )
    return HorizontalState(command, integral), p.k_v_per_s * error + integral


@inlined_expression
def _attitude_step(
    reference: Any, angle: Any, rate: Any, integrals: PidState, pid: AttitudePid, dt_s: Any
) -> Any:
    """Return the next state of one attitude loop and its torque command."""
    next_integrals = next_pid_state(reference, angle, rate, integrals, pid, dt_s)
    return next_integrals, attitude_torque(reference, angle, rate, next_integrals, pid)


@inlined_expression
def flight_step(
    p: FlightNumbers, state: FlightLawState, measured: Any, reference: Any, dt_s: Any
) -> Any:
    """Return state and command for the control period that begins now."""
    roll, pitch, yaw = measured.roll_rad, measured.pitch_rad, measured.yaw_rad
    ex, ey = reference.x_m - measured.x_m, reference.y_m - measured.y_m
    distance_m = math.sqrt(ex * ex + ey * ey)
    speed_limit = reference.speed_m_s if p.ramp == 0.0 else RAMP_MAX_SPEED_M_S
    limit_x, limit_y = speed_limit, speed_limit
    if distance_m > 0.0:
        limit_x, limit_y = speed_limit * abs(ex) / distance_m, speed_limit * abs(ey) / distance_m
    x, ax = horizontal_step(ex, limit_x, measured.vx_m_s, state.x, p.position, dt_s)
    y, ay = horizontal_step(ey, limit_y, measured.vy_m_s, state.y, p.position, dt_s)
    cosine, sine = math.cos(yaw), math.sin(yaw)
    forward_m_s2, left_m_s2 = cosine * ax + sine * ay, cosine * ay - sine * ax
    pitch_reference = pitch_command(forward_m_s2, p.gravity_m_s2, p.position)
    roll_reference = -pitch_command(left_m_s2, p.gravity_m_s2, p.position)
    yaw_error = reference.yaw_rad - yaw
    yaw_error -= 2.0 * math.pi * math.floor(yaw_error / (2.0 * math.pi) + 0.5)
    attitude = Attitude(roll_reference, pitch_reference, yaw + yaw_error)
    roll_rate, pitch_rate, yaw_rate = measured.p_rad_s, measured.q_rad_s, measured.r_rad_s
    roll_loop, roll_Nm = _attitude_step(
        attitude.roll_rad, roll, roll_rate, state.roll, p.roll, dt_s
    )
    pitch_loop, pitch_Nm = _attitude_step(
        attitude.pitch_rad, pitch, pitch_rate, state.pitch, p.pitch, dt_s
    )
    yaw_loop, yaw_Nm = _attitude_step(attitude.yaw_rad, yaw, yaw_rate, state.yaw, p.yaw, dt_s)
    ez = reference.z_m - measured.z_m
    climb_integral = integrate_clamped(state.climb_m_s2, p.k_iz_per_s3 * ez, np.inf, dt_s)
    climb = climb_command(
        ez, measured.vz_m_s, climb_integral, p.k_z_per_s2, p.k_vz_per_s, p.climb_limit_m_s2
    )
    cos_roll, cos_pitch = math.cos(roll), math.cos(pitch)
    thrust = lifting_thrust(climb, p.mass_kg, p.gravity_m_s2, cos_pitch * cos_roll)

    enabled = 1.0 if p.observer_per_s > 0.0 and measured.time_s >= p.from_s else 0.0
    jx, jy, jz = p.roll.inertia_kgm2, p.pitch.inertia_kgm2, p.yaw.inertia_kgm2
    momentum = (
        p.mass_kg * measured.vx_m_s, p.mass_kg * measured.vy_m_s, p.mass_kg * measured.vz_m_s,
        jx * roll_rate, jy * pitch_rate, jz * yaw_rate,
    )  # fmt: skip
    estimate = Wrench(*_estimate_all(momentum, state.explained, p.observer_per_s, enabled))
    compensated_share = enabled * p.compensate
    tx = roll_Nm - compensated_share * estimate.roll_Nm
    ty = pitch_Nm - compensated_share * estimate.pitch_Nm
    tz = yaw_Nm - compensated_share * estimate.yaw_Nm
    sin_roll, sin_pitch = math.sin(roll), math.sin(pitch)
    force = (
        thrust * (cosine * sin_pitch * cos_roll + sine * sin_roll),
        thrust * (sine * sin_pitch * cos_roll - cosine * sin_roll),
        thrust * cos_pitch * cos_roll - p.mass_kg * p.gravity_m_s2,
        tx + (jy - jz) * pitch_rate * yaw_rate,
        ty + (jz - jx) * yaw_rate * roll_rate,
        tz + (jx - jy) * roll_rate * pitch_rate,
    )
    parts = (momentum, state.explained, force, estimate)
    next_state = FlightLawState(
        x, y, climb_integral, roll_loop, pitch_loop, yaw_loop,
        Wrench(*_explain_all(parts, enabled, dt_s)), estimate, attitude,
    )  # fmt: skip
    return next_state, FlightCommand(thrust, tx, ty, tz, ())


def flight_numbers(case: Any, body: Body) -> FlightNumbers:
    """Return the law's numbers for a `FlightCase` and the nominal body."""
    gains: Gains = case.gains
    attitude, yaw, position = gains.attitude, gains.yaw, gains.position

    def build_tilt_loop(inertia_kgm2: float) -> AttitudePid:
        values = {name: getattr(attitude, name) for name in attitude.__slots__}
        return AttitudePid(**values, inertia_kgm2=inertia_kgm2, torque_limit_Nm=math.inf)

    yaw_loop = AttitudePid(
        yaw.k_psi_per_s, 0.0, 1.0, attitude.rate_limit_rad_s, yaw.k_r_per_s, 0.0, 1.0,
        body.inertia_zz_kgm2, math.inf,
    )  # fmt: skip
    return FlightNumbers(
        PositionLoop(*(getattr(position, name) for name in PositionLoop._fields)),
        build_tilt_loop(body.inertia_xx_kgm2),
        build_tilt_loop(body.inertia_yy_kgm2),
        yaw_loop,
        gains.altitude.k_z_per_s2,
        gains.altitude.k_vz_per_s,
        gains.altitude.k_iz_per_s3,
        gains.altitude.limit_m_s2,
        gains.observer.rate_per_s,
        float(case.control in ("observer", "both")),
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

LAWS: tuple[ControlLaw, ...] = (pitch.LAW, LAW)  # built-in laws; add a new one here

_HINGED, _FREE = (
    {law.name: law.title for law in LAWS if law.body == body and law.name != "pid"}
    for body in ("hinged", "free")
)
PITCH_CONTROLLERS = {  # built-in controllers of the pitch bench with their titles
    "pid": pitch.LAW.title,
    "observer": "PID with the disturbance observer of eq. (12)",
    "feedforward": "PID with each rotor's thrust divided by the expected factor",
    "observer+feedforward": "PID with both",
    **_HINGED,
    **{f"{name}+feedforward": f"{title}; with the feedforward" for name, title in _HINGED.items()},
}

FLIGHT_CONTROLLERS = {  # built-in controllers of a flight with their labels in figures
    "pid": LAW.title,
    "observer": "PID + observer",
    "feedforward": "PID + feedforward",
    "both": "PID + observer + feedforward",
    **_FREE,
    **{f"{name}+feedforward": f"{title} + feedforward" for name, title in _FREE.items()},
}


def find_law(controller: str, body: str) -> ControlLaw:
    """Return the law of a built-in controller of a body; PID where the name contains no law."""
    body_laws = [law for law in LAWS if law.body == body]
    return next((law for law in body_laws if law.name in controller.split("+")), body_laws[0])


def build_pitch_controller(
    name: str, gains: Gains, feedforward: Feedforward | None = None
) -> PitchControl:
    """Return a built-in controller by name.

    Args:
        feedforward: settings of a feedforward; 90 % of the true effect by default (assumed: a
            model is never exact).
    """
    if name not in PITCH_CONTROLLERS:
        raise UnknownChoice("controller", name, PITCH_CONTROLLERS)
    parts = name.split("+")
    expected_effect = feedforward if feedforward is not None else Feedforward(strength=0.9)
    return PitchControl(
        name=name,
        gains=gains,
        observer="observer" in parts,
        feedforward=expected_effect if "feedforward" in parts else Feedforward(),
        law=find_law(name, "hinged"),
    )
