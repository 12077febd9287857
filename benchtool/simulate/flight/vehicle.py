"""Vehicle of a flight: free rigid body, model of its ground effect, and further numbers.

Axes: world x, y horizontal and z up; body x forward, y left, z up. The quaternion turns body
vectors into world vectors. Euler angles are yaw, pitch, roll in that order; positive pitch is nose
down, positive roll lifts the left side (as the rows of `physics.mixer`).

A step is drift, kick, drift (Strang's splitting): position and attitude change for half a step at
constant velocities, velocities for a whole step under the forces there, then the second half
follows. Second order, time-reversible, one evaluation of the forces.
"""

from __future__ import annotations

import math
from collections import namedtuple
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from benchtool.core.errors import InputError
from benchtool.core.parameter import Parameter, resolve_name
from benchtool.core.rig import Rig
from benchtool.core.units import Array
from benchtool.physics.bases import with_rig_blades
from benchtool.physics.body_lift import BodyImages
from benchtool.physics.catalogue import EFFECTS
from benchtool.physics.effects.effect import Effect
from benchtool.physics.effects.neighbour_images import EFFECT as NEIGHBOURS
from benchtool.physics.expression import expression, inlined_expression
from benchtool.physics.model import Model
from benchtool.physics.rotor import mixer_matrix
from benchtool.simulate.controllers.controller import GRAVITY_M_S2
from benchtool.simulate.hooks import neutral_value
from benchtool.simulate.inputs import check_range

# Short names of effect parameters, with their own names.
SHORT_NAMES = {"K_b": "K_b", "neighbours": f"{NEIGHBOURS.name}.strength", "lag_s": "tau_s"}

RULES = ("wake_rule", "tilt_rule", "body_distance")  # model choices, from ambiguities of the paper

RANGES = {
    "K_b": (0.0, 50.0),
    "neighbours": (0.0, 10.0),
    "lag_s": (0.0, 10.0),
    "drag_N_s_m": (0.0, 1e3),
    "turned_deg": (-360.0, 360.0),
    "inertia_scale": (0.01, 100.0),
    "undercarriage_m": (0.0, 10.0),
}

Craft = namedtuple(
    "Craft",
    "mass_kg inertia_kgm2 k_N_s2 c_Nm_s2 top_speed_rad_s drag_N_s_m gravity_m_s2 radius_m "
    "effective_radius_m depth_m x_m y_m spin per_thrust per_roll per_pitch per_yaw",
)
"""Numbers of a vehicle.

Attributes:
    inertia_kgm2: principal moments (3,).
    radius_m, effective_radius_m: of a disc, for areas and for the strength of the images.
    depth_m: depth of hub and legs below the discs.
    x_m, y_m, spin: of the rotors (n,).
    per_thrust, per_roll, per_pitch, per_yaw: mixer weights of each rotor (n,).
"""


class FlightGeometry(NamedTuple):
    """Plant step, disc positions (n,) and distances (n, n), body sources (n_body,)."""

    dt_s: Any
    x_m: Any
    y_m: Any
    distances_m: Any
    body: BodyImages


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FlightVehicle:
    """Flying vehicle.

    Attributes:
        drag_N_s_m: force per velocity relative to the air; with 0 wind has no effect.
        turned_deg: rotation of the layout to the left: 45 makes a plus layout a cross.
        inertia_scale: true over nominal inertia; the controller uses the nominal one.
        undercarriage_m: depth of hub and legs below the rotors, equal everywhere under the discs;
            0 means none, as no rig file has them.
    """

    model: Model
    drag_N_s_m: float = 0.0
    turned_deg: float = 0.0
    inertia_scale: float = 1.0
    undercarriage_m: float = 0.0

    def __post_init__(self) -> None:
        for item in fields(self)[1:]:
            check_range(item.name, getattr(self, item.name), *RANGES[item.name])

    @classmethod
    def of_rig(cls, rig: Rig, **numbers: float) -> FlightVehicle:
        """Return the vehicle of a rig with eq. (4): the effects that act at their default values.

        They include the blades of the rig if it has any.
        """
        if rig.plate.surface != "below":  # of its bench; in flight surfaces are below
            rig = replace(rig, plate=replace(rig.plate, surface="below"))
        model = with_rig_blades(Model.single(rig))
        for effect in EFFECTS.values():
            acts = any(
                item.neutral is not None and not item.is_neutral for item in effect.parameters
            )
            if effect.distance_law is not None or effect.rig_values is not None or not acts:
                continue  # defined by model or rig, or absent by default
            if all(effect.name != present.name for present in model.effects):
                model = model.with_effect(effect)
        return cls(model=model).with_numbers(**numbers)

    def with_numbers(self, **numbers: Any) -> FlightVehicle:
        """Return the vehicle with some numbers changed.

        A name is a field of the vehicle, one of `RULES`, one of `SHORT_NAMES`, or an effect
        parameter as in `resolve_name`; missing effects are added to the model.

        Raises:
            InputError: a number is out of range.
            UnknownChoice: unknown name.
        """
        field_names = {item.name for item in fields(self)}
        changed = self
        for name, value in numbers.items():
            if name in field_names:
                changed = replace(changed, **{name: value})
            elif name in RULES:
                changed = replace(changed, model=replace(changed.model, **{name: value}))
            else:
                changed = replace(changed, model=_with_parameter(changed.model, name, float(value)))
        return changed

    def number(self, name: str) -> float:
        """Return a number by its name as in `with_numbers`; neutral if its effect is absent."""
        if name in RANGES and name not in SHORT_NAMES:
            return float(getattr(self, name))
        effect, parameter = find_effect_parameter(self.model, name)
        if (full_name := f"{effect.name}.{parameter.name}") in self.model.parameters:
            return self.model.parameters[full_name].value
        return neutral_value(parameter)

    @property
    def rig(self) -> Rig:
        """Rotors, propulsion, body."""
        return self.model.rig

    @property
    def idle_effects(self) -> tuple[Effect, ...]:
        """Effects of the model without influence in flight: of hinge, load cell or stage."""
        present = self.model.present_effects
        return tuple(effect for effect in present if not effect.acts_in_flight)

    @property
    def hover_thrust_N(self) -> float:
        """Thrust of one rotor in hover out of ground effect: N."""
        return self.rig.body.mass_kg * GRAVITY_M_S2 / self.rig.n_rotors

    @property
    def reach_m(self) -> float:
        """Largest distance of a disc edge from the centre: m."""
        positions_m = self.rig.disc_positions_m
        arms_m = np.hypot(positions_m[:, 0], positions_m[:, 1])
        return float(arms_m.max() + self.rig.propulsion.radius_m)

    def turned(self, x_m: Array, y_m: Array) -> tuple[Array, Array]:
        """Return positions of the rig in the rotated layout."""
        if not self.turned_deg:
            return x_m, y_m
        c, s = math.cos(math.radians(self.turned_deg)), math.sin(math.radians(self.turned_deg))
        return c * x_m - s * y_m, s * x_m + c * y_m

    def geometry(self, dt_s: float) -> FlightGeometry:
        """Return the geometry for plant steps."""
        x, y = (tuple(part.tolist()) for part in self.turned(*self.rig.disc_positions_m.T))
        body, distances_m = self.model.body_images, self.rig.disc_distances_m.tolist()
        sources = (*self.turned(body.x_m, body.y_m), body.arm_m)
        images = BodyImages(*(tuple(part.tolist()) for part in sources))
        return FlightGeometry(dt_s, x, y, tuple(map(tuple, distances_m)), images)

    def craft(self) -> Craft:
        """Return the numbers of the vehicle, with the mixer weights of each rotor."""
        rig, values = self.rig, self.model.parameters
        rotors = np.array([(rotor.x_m, rotor.y_m, rotor.spin) for rotor in rig.rotors], float).T
        layout = (*self.turned(rotors[0], rotors[1]), rotors[2])
        x, y, spin = (tuple(row.tolist()) for row in layout)
        propulsion = rig.propulsion
        k, c = values["k"].value, propulsion.drag_coefficient_Nm_s2
        weights = mixer_weights(x, y, spin, k, c)
        if not weights:
            raise InputError(
                f"the rotors of rig {rig.name!r} ({rig.n_rotors}) cannot produce thrust "
                f"and three torques independently; use a rig with four rotors or more"
            )
        body, scale = rig.body, self.inertia_scale
        pitch_inertia_kgm2 = values["inertia_kgm2"].value
        inertia = (body.inertia_xx_kgm2, pitch_inertia_kgm2, body.inertia_zz_kgm2)
        max_pulse_us = propulsion.pwm_max_us - propulsion.pwm_start_us
        return Craft(
            body.mass_kg,
            tuple(scale * moment for moment in inertia),
            k,
            c,
            propulsion.speed_per_us_rad_s * max_pulse_us,
            float(self.drag_N_s_m),
            GRAVITY_M_S2,
            propulsion.radius_m,
            values["R_m"].value,
            float(self.undercarriage_m),
            *(x, y, spin, *weights),
        )


@lru_cache(maxsize=64)
def mixer_weights(
    x_m: tuple[float, ...], y_m: tuple[float, ...], spin: tuple[float, ...], k: float, c: float
) -> tuple[tuple[float, ...], ...]:
    """Return the weight of each rotor for thrust and three torques (4, n), as `Craft`.

    The result is empty if rotors cannot produce them independently.
    """
    matrix = mixer_matrix(np.array(x_m), np.array(y_m), np.array(spin), k, c)
    row_max = np.abs(matrix).max(axis=1, keepdims=True)
    if not row_max.all() or np.linalg.matrix_rank(matrix / row_max) < 4:
        return ()
    return tuple(tuple(row) for row in (k * np.linalg.pinv(matrix)).T.tolist())


def find_effect_parameter(model: Model, name: str) -> tuple[Effect, Parameter]:
    """Return the effect with a parameter of that name, and the parameter."""
    effects = {effect.name: effect for effect in (*EFFECTS.values(), *model.effects)}
    by_name = {
        f"{effect.name}.{parameter.name}": (effect, parameter)
        for effect in effects.values()
        for parameter in effect.parameters
        if name not in SHORT_NAMES or effect.distance_law is None
    }
    full_name = resolve_name(SHORT_NAMES.get(name, name), by_name, "number of a vehicle")
    return by_name[full_name]


def _with_parameter(model: Model, name: str, value: float) -> Model:
    effect, parameter = find_effect_parameter(model, name)
    low, high = RANGES.get(name, (parameter.lower, parameter.upper))
    check_range(name, value, low, high)
    full_name = f"{effect.name}.{parameter.name}"
    if full_name not in model.parameters:
        if value == parameter.neutral:
            return model
        model = model.with_effect(effect)
    lower, upper = min(parameter.lower, low), max(parameter.upper, high)
    changed = replace(model.parameters[full_name], value=value, lower=lower, upper=upper)
    return model.with_values(model.parameters.with_replaced(full_name, changed))


SMALL_TURN = 1e-4  # rad2; below it the series in `drift` are exact to rounding (2e-16)

# State of a body: position and velocity in the world, attitude, body rates, and the random torque
# about the pitch axis.
FreeBody = namedtuple(
    "FreeBody",
    "x_m y_m z_m vx_m_s vy_m_s vz_m_s qw qx qy qz p_rad_s q_rad_s r_rad_s wake_Nm",
    defaults=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
)


def at_rest(position_m: tuple[float, float, float], yaw_rad: float = 0.0) -> FreeBody:
    """Return a level body at rest."""
    return FreeBody(*position_m, qw=math.cos(0.5 * yaw_rad), qz=math.sin(0.5 * yaw_rad))


@inlined_expression
def roll_angle(body: Any) -> Any:
    """Return the roll: rad."""
    w, x, y, z = body.qw, body.qx, body.qy, body.qz
    return math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))


@inlined_expression
def pitch_angle(body: Any) -> Any:
    """Return the pitch, nose down: rad."""
    return math.asin(min(max(2.0 * (body.qw * body.qy - body.qz * body.qx), -1.0), 1.0))


@inlined_expression
def yaw_angle(body: Any) -> Any:
    """Return the yaw: rad."""
    w, x, y, z = body.qw, body.qx, body.qy, body.qz
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


@expression
def upward(body: Any) -> Any:
    """Return the z axis of the body in world axes (3,): the thrust direction."""
    w, x, y, z = body.qw, body.qx, body.qy, body.qz
    return 2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)


@expression
def forward(body: Any) -> Any:
    """Return the x axis of the body in world axes (3,)."""
    w, x, y, z = body.qw, body.qx, body.qy, body.qz
    return 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)


@expression
def leftward(body: Any) -> Any:
    """Return the y axis of the body in world axes (3,)."""
    w, x, y, z = body.qw, body.qx, body.qy, body.qz
    return 2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)


@inlined_expression
def drift(body: Any, dt_s: Any) -> Any:
    """Return the body moved at constant velocities; exact for a constant body rate."""
    p, q, r = body.p_rad_s, body.q_rad_s, body.r_rad_s
    squared = 0.25 * dt_s * dt_s * (p * p + q * q + r * r)
    if squared < SMALL_TURN:
        along = 0.5 * dt_s * (1.0 - squared / 6.0 * (1.0 - squared / 20.0))
        cosine = 1.0 - 0.5 * squared * (1.0 - squared / 12.0 * (1.0 - squared / 30.0))
    else:
        half = math.sqrt(squared)
        along, cosine = 0.5 * dt_s * math.sin(half) / half, math.cos(half)
    a, b, c = p * along, q * along, r * along
    w, x, y, z = body.qw, body.qx, body.qy, body.qz
    return FreeBody(
        body.x_m + body.vx_m_s * dt_s,
        body.y_m + body.vy_m_s * dt_s,
        body.z_m + body.vz_m_s * dt_s,
        body.vx_m_s,
        body.vy_m_s,
        body.vz_m_s,
        w * cosine - x * a - y * b - z * c,
        w * a + x * cosine + y * c - z * b,
        w * b - x * c + y * cosine + z * a,
        w * c + x * b - y * a + z * cosine,
        p,
        q,
        r,
        body.wake_Nm,
    )


@inlined_expression
def rates_after_impulse(body: Any, torque_Nm: Any, inertia_kgm2: Any, dt_s: Any) -> Any:
    """Return the body rates (3,) after a torque in body axes (3,), with the gyroscopic coupling.

    J dw/dt = tau - w x J w by the implicit midpoint rule, four fixed-point iterations: it conserves
    energy and angular momentum of a free body to the order of the iterations.
    `inertia_kgm2` (3,) are the principal moments.
    """
    roll_Nm, pitch_Nm, yaw_Nm = torque_Nm
    jx, jy, jz = inertia_kgm2
    p0, q0, r0 = body.p_rad_s, body.q_rad_s, body.r_rad_s
    dp, dq, dr = dt_s * roll_Nm / jx, dt_s * pitch_Nm / jy, dt_s * yaw_Nm / jz
    cx, cy, cz = dt_s * (jy - jz) / jx, dt_s * (jz - jx) / jy, dt_s * (jx - jy) / jz
    p, q, r = p0 + dp, q0 + dq, r0 + dr
    for _ in range(4):
        pm, qm, rm = 0.5 * (p0 + p), 0.5 * (q0 + q), 0.5 * (r0 + r)
        p, q, r = p0 + dp + cx * qm * rm, q0 + dq + cy * rm * pm, r0 + dr + cz * pm * qm
    return p, q, r


@inlined_expression
def apply_impulse(body: Any, velocity_m_s: Any, rates_rad_s: Any, wake_Nm: Any) -> Any:
    """Return the body with new velocities (3,), body rates (3,) and wake torque."""
    vx, vy, vz = velocity_m_s
    p, q, r = rates_rad_s
    return FreeBody(
        body.x_m, body.y_m, body.z_m, vx, vy, vz,
        body.qw, body.qx, body.qy, body.qz, p, q, r, wake_Nm,
    )  # fmt: skip
