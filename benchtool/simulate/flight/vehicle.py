"""A vehicle for the flight simulator: a model of its ground effect, and what flying adds to it."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from math import cos, radians, sin
from typing import Any

import numpy as np

from benchtool.core.array_type import Array
from benchtool.core.errors import InputError
from benchtool.core.parameter import Parameter, resolve_name
from benchtool.core.rig import Rig
from benchtool.physics.bases import with_blades_of_rig
from benchtool.physics.catalogue import EFFECTS
from benchtool.physics.effects.effect import Effect
from benchtool.physics.effects.neighbour_images import EFFECT as NEIGHBOURS
from benchtool.physics.mixer import mixer_matrix
from benchtool.physics.model import Model
from benchtool.simulate.flight.records import Craft
from benchtool.simulate.flight.rigid_body import GRAVITY_M_S2
from benchtool.simulate.ranges import refuse_outside

SHORT_NAMES = {"K_b": "K_b", "neighbours": f"{NEIGHBOURS.name}.strength", "lag_s": "tau_s"}
"""What a flight calls some effects' numbers, and their own names."""

RULES = ("wake_rule", "tilt_rule", "body_distance")  # readings of the paper that a model chooses

RANGES = {
    "K_b": (0.0, 50.0),
    "neighbours": (0.0, 10.0),
    "lag_s": (0.0, 10.0),
    "drag_N_s_m": (0.0, 1e3),
    "turned_deg": (-360.0, 360.0),
    "inertia_scale": (0.01, 100.0),
    "undercarriage_m": (0.0, 10.0),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightVehicle:
    """Describe a vehicle in the air.

    Attributes:
        drag_N_s_m: force per velocity against the air; 0 leaves wind without effect.
        turned_deg: layout turned to the left: 45 makes a plus layout a cross.
        inertia_scale: true over known inertia; the controller keeps the known one.
        undercarriage_m: how far hub and legs reach below the rotors, taken as deep everywhere under
            the discs; 0 leaves them out, as no rig file has them.
    """

    model: Model
    drag_N_s_m: float = 0.0
    turned_deg: float = 0.0
    inertia_scale: float = 1.0
    undercarriage_m: float = 0.0

    def __post_init__(self) -> None:
        for item in fields(self)[1:]:
            refuse_outside(item.name, getattr(self, item.name), *RANGES[item.name])

    @classmethod
    def of_rig(cls, rig: Rig, **numbers: float) -> FlightVehicle:
        """Return a rig's vehicle with eq. (4): the effects that act at their default values.

        The rig's blades are among them where it states any.
        """
        if rig.plate.surface != "below":  # where its bench has a plate; a flight has floors
            rig = replace(rig, plate=replace(rig.plate, surface="below"))
        model = with_blades_of_rig(Model.single(rig))
        usual = (effect for effect in EFFECTS.values() if _acts_by_default(effect))
        for effect in usual:
            if all(effect.name != present.name for present in model.effects):
                model = model.with_effect(effect)
        return cls(model=model).with_numbers(**numbers)

    def with_numbers(self, **numbers: Any) -> FlightVehicle:
        """Return the vehicle with some numbers changed.

        A name is a field of the vehicle, one of `RULES` of its model, one of
        `SHORT_NAMES`, or an effect's number as in `resolve_name`; an effect that the model lacks is
        put in.

        Raises:
            InputError: a number outside its range.
            UnknownChoice: no such number.
        """
        own = {item.name for item in fields(self)}
        changed = self
        for name, value in numbers.items():
            if name in own:
                changed = replace(changed, **{name: value})
            elif name in RULES:
                changed = replace(changed, model=replace(changed.model, **{name: value}))
            else:
                changed = replace(changed, model=_at(changed.model, name, float(value)))
        return changed

    def number(self, name: str) -> float:
        """Return a number by a name as in `with_numbers`; neutral where its effect is absent."""
        if name in RANGES and name not in SHORT_NAMES:
            return float(getattr(self, name))
        effect, item = owner_of(self.model, name)
        if (full := f"{effect.name}.{item.name}") in self.model.parameters:
            return self.model.parameters[full].value
        return item.value if item.neutral is None else item.neutral

    @property
    def rig(self) -> Rig:
        """Rotors, propulsion, body."""
        return self.model.rig

    @property
    def identity(self) -> tuple[Any, ...]:
        """What distinguishes the vehicle from others, as something that can be compared."""
        values = {name: item.value for name, item in self.model.parameters.items()}
        places = self.rig.disc_positions_m.tolist()
        own = [getattr(self, item.name) for item in fields(self)[1:]]
        rules = [getattr(self.model, name) for name in RULES]
        return (self.rig.name, places, rules, values, own)

    @property
    def idle_effects(self) -> tuple[Effect, ...]:
        """Effects of the model that cannot act in flight: of a hinge, a load cell, a stage."""
        present = self.model.present_effects
        return tuple(effect for effect in present if not effect.acts_in_flight)

    @property
    def hover_thrust_N(self) -> float:
        """Thrust of one rotor in hover far from everything: N."""
        return self.rig.body.mass_kg * GRAVITY_M_S2 / self.rig.n_rotors

    @property
    def reach_m(self) -> float:
        """How far from the centre the discs reach: m."""
        places = self.rig.disc_positions_m
        return float(np.hypot(places[:, 0], places[:, 1]).max() + self.rig.propulsion.radius_m)

    def turned(self, x_m: Array, y_m: Array) -> tuple[Array, Array]:
        """Return places of the rig in the layout as it is turned."""
        if not self.turned_deg:
            return x_m, y_m
        c, s = cos(radians(self.turned_deg)), sin(radians(self.turned_deg))
        return c * x_m - s * y_m, s * x_m + c * y_m

    def geometry(self, dt_s: float) -> Array:
        """Return plant step, places and distances as the loop takes them, see `FlightGeometry`."""
        places = self.rig.disc_positions_m
        x, y = self.turned(places[:, 0], places[:, 1])
        body = self.model.body_images
        sources = [*self.turned(body.x_m, body.y_m), body.arm_m]
        parts: list[Any] = [dt_s, x, y, self.rig.disc_distances_m, *sources]
        return np.concatenate([np.ravel(part) for part in parts])

    def craft(self) -> Craft:
        """Return the vehicle's numbers, with what the mixer shares out to each rotor."""
        rig, values = self.rig, self.model.parameters
        x, y = self.turned(
            np.array([rotor.x_m for rotor in rig.rotors], float),
            np.array([rotor.y_m for rotor in rig.rotors], float),
        )
        spin = np.array([rotor.spin for rotor in rig.rotors], float)
        propulsion = rig.propulsion
        k, c = values["k"].value, propulsion.drag_coefficient_Nm_s2
        matrix = mixer_matrix(x, y, spin, k, c)
        largest = np.abs(matrix).max(axis=1, keepdims=True)
        if not largest.all() or np.linalg.matrix_rank(matrix / largest) < 4:
            raise InputError(
                f"the rotors of rig {rig.name!r} ({rig.n_rotors}) cannot make thrust and "
                f"three torques independently; fly a rig with four rotors or more"
            )
        shares = k * np.linalg.pinv(matrix)
        body, scale = rig.body, self.inertia_scale
        pitch_inertia_kgm2 = values["inertia_kgm2"].value
        inertia = (body.inertia_xx_kgm2, pitch_inertia_kgm2, body.inertia_zz_kgm2)
        top_us = propulsion.pwm_max_us - propulsion.pwm_start_us
        return Craft(
            body.mass_kg,
            tuple(scale * each for each in inertia),
            k,
            c,
            propulsion.speed_per_us_rad_s * top_us,
            float(self.drag_N_s_m),
            GRAVITY_M_S2,
            propulsion.radius_m,
            values["R_m"].value,
            float(self.undercarriage_m),
            *(tuple(row.tolist()) for row in (x, y, spin, *shares.T)),
        )


def owner_of(model: Model, name: str) -> tuple[Effect, Parameter]:
    """Return the effect that has a number of that name, and the number as it is or would be."""
    effects = {effect.name: effect for effect in (*EFFECTS.values(), *model.effects)}
    known = {
        f"{one.name}.{item.name}": (one, item)
        for one in effects.values()
        for item in one.parameters
        if name not in SHORT_NAMES or one.distance_law is None
    }
    full = resolve_name(SHORT_NAMES.get(name, name), known, "number of a vehicle")
    return known[full]


def _at(model: Model, name: str, value: float) -> Model:
    effect, item = owner_of(model, name)
    low, high = RANGES.get(name, (item.lower, item.upper))
    refuse_outside(name, value, low, high)
    full = f"{effect.name}.{item.name}"
    if full not in model.parameters:
        if value == item.neutral:
            return model
        model = model.with_effect(effect)
    set_to = replace(
        model.parameters[full], value=value, lower=min(item.lower, low), upper=max(item.upper, high)
    )
    return model.with_values(model.parameters.with_replaced(full, set_to))


def _acts_by_default(effect: Effect) -> bool:
    if effect.distance_law is not None or effect.rig_values is not None:  # model or rig decides
        return False
    return any(item.neutral is not None and not item.is_neutral for item in effect.parameters)
