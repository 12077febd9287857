"""Model of a bench: a rig, baseline parameters and effects.

The baseline is thrust k w^2 (eq. 8) of each rotor, with the parameters `k` (thrust coefficient of
one rotor), `R_m` (effective radius) and, for a pitch bench, `inertia_kgm2`. All else are effects,
including the law of thrust against distance, by default eq. (2).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.parameter import Parameters, resolve_name
from benchtool.core.rig import Rig
from benchtool.core.units import Array
from benchtool.physics.baseline import DiscrepancyTolerances, baseline_parameters
from benchtool.physics.body_lift import BodyDistance, BodyImages, body_images, wake_rule
from benchtool.physics.catalogue import EFFECTS, find_effect, thrust_laws
from benchtool.physics.conditions import Conditions
from benchtool.physics.disc_thrust import DiscThrust, ImageRules, bound_hooks, disc_thrust
from benchtool.physics.effects.effect import NO_FLOW, Effect, Flow, Quantity
from benchtool.physics.effects.laws.table import DEFAULT_LAWS
from benchtool.physics.effects.rotor_images import EFFECT as ROTOR_IMAGES
from benchtool.physics.fold import Hook, chain_hooks
from benchtool.physics.images import Plane, height_over, plate_plane, tilt_rule
from benchtool.physics.rotor import speed_near_plate, torque_per_speed

OWN_IMAGES = ROTOR_IMAGES.name  # eq. (2), the default law of a plate below


@dataclass(frozen=True, kw_only=True)
class Model:
    """Predictor of the readings of a bench."""

    name: str
    rig: Rig
    parameters: Parameters  # of baseline and effects, by full name ("R_m", "body_lift.K_b")
    effects: tuple[Effect, ...] = ()
    wake_rule: str = "notes"
    tilt_rule: str = "axis"
    # B of eq. (4): half the diagonal (as derived) or the diagonal (as printed)
    body_distance: BodyDistance = "half_diagonal"
    # Tolerances of laws and sensors
    discrepancy: DiscrepancyTolerances = field(default_factory=DiscrepancyTolerances)
    description: str = ""
    provenance: Mapping[str, str] = field(default_factory=dict)

    def __repr__(self) -> str:
        values = ", ".join(f"{name} = {self.parameters[name].value:g}" for name in ("k", "R_m"))
        return (
            f"Model {self.name} on rig {self.rig.name}\n"
            f"  effects: {', '.join(effect.name for effect in self.effects) or 'none'}\n"
            f"  {values}; free: {', '.join(self.parameters.free_names) or 'none'}"
        )

    @classmethod
    def single(cls, rig: Rig, name: str = "single") -> Model:
        """Return the baseline and the default law for the rig's surface: eq. (2) for one below."""
        bare = cls(name=name, rig=rig, parameters=baseline_parameters(rig))
        return bare.with_effect(DEFAULT_LAWS[rig.plate.surface])

    def __post_init__(self) -> None:
        wake_rule(self.wake_rule), tilt_rule(self.tilt_rule)
        laws = [effect for effect in self.effects if effect.distance_law is not None]
        surface = self.rig.plate.surface
        for law in laws:
            if law.distance_law is not None and law.distance_law.surface != surface:
                names = ", ".join(effect.name for effect in thrust_laws(surface))
                raise InputError(
                    f"law {law.name} is for a surface {law.distance_law.surface} the rotors, but "
                    f"the plate of rig {self.rig.name!r} is {surface}; allowed: {names}"
                )
        if len(laws) > 1 and len(present := [e.name for e in laws if self.is_present(e)]) > 1:
            raise InputError(
                f"model {self.name!r} has several laws of thrust against distance: "
                f"{' and '.join(present)}; remove all but one"
            )

    def with_effect(self, effect: str | Effect, **values: float) -> Model:
        """Return the model with an additional effect, its parameters at `values` or their defaults.

        Defaults of parameters without a neutral value are those of the rig, if it has them.
        """
        effect = find_effect(effect) if isinstance(effect, str) else effect
        if any(present.name == effect.name for present in self.effects):
            raise InputError(f"duplicate effect {effect.name!r} in model {self.name!r}")
        parameters = {parameter.name: parameter for parameter in effect.parameters}
        for name in values:
            if name not in parameters:
                raise UnknownChoice(f"parameter of effect {effect.name!r}", name, parameters)
        rig_values = effect.rig_values(self.rig) if effect.rig_values is not None else {}
        rig_values = {key: rig_values[key] for key in rig_values if parameters[key].neutral is None}
        values = {**rig_values, **values}
        new = [
            (f"{effect.name}.{name}", item.with_value(values[name]) if name in values else item)
            for name, item in parameters.items()
        ]
        return replace(
            self,
            effects=(*self.effects, effect),
            parameters=Parameters((*self.parameters.items(), *new)),
        )

    def with_law(self, law: str | Effect, **values: float) -> Model:
        """Return the model with its law of thrust against distance replaced."""
        model = self
        for effect in self.effects:
            if effect.distance_law is not None:
                model = model.without(effect.name)
        return model.with_effect(law, **values)

    def with_rig_lag(self) -> Model:
        """Return the model with the motor lag of the rig, unless it has a lag effect."""
        if any(effect.hooks.lag_s is not None for effect in self.effects):
            return self
        lag = next(effect for effect in EFFECTS.values() if effect.hooks.lag_s is not None)
        assert lag.rig_values is not None
        return self.with_effect(lag, **lag.rig_values(self.rig))

    def without(self, name: str) -> Model:
        """Return the model without one effect."""
        if all(effect.name != name for effect in self.effects):
            raise UnknownChoice(
                f"effect of model {self.name!r}", name, (effect.name for effect in self.effects)
            )
        return replace(
            self,
            effects=tuple(effect for effect in self.effects if effect.name != name),
            parameters=Parameters(
                (key, item)
                for key, item in self.parameters.items()
                if not key.startswith(f"{name}.")
            ),
        )

    def with_values(self, parameters: Parameters) -> Model:
        """Return the model with its parameters replaced."""
        return replace(self, parameters=parameters)

    def with_free(self, *names: str) -> Model:
        """Return the model with those parameters free and the others unchanged.

        The last part of a name is sufficient if it is unique.
        """
        parameters = self.parameters
        for name in names:
            full_name = resolve_name(name, self.parameters)
            parameters = parameters.with_replaced(full_name, parameters[full_name].as_free())
        return self.with_values(parameters)

    def with_fixed(self, name: str, value: float | None = None) -> Model:
        """Return the model with one parameter fixed, by default at its value."""
        full_name = resolve_name(name, self.parameters)
        return self.with_values(
            self.parameters.with_replaced(full_name, self.parameters[full_name].as_fixed(value))
        )

    @cached_property
    def _index(self) -> dict[str, int]:
        return {name: position for position, name in enumerate(self.parameters)}

    def effect_values(self, effect: Effect, values: Any) -> list[Any]:
        """Return the effect's slice of `values` (n_parameters, ...), in the order of the effect."""
        return [values[self._index[f"{effect.name}.{item.name}"]] for item in effect.parameters]

    def is_present(self, effect: Effect) -> bool:
        """Return True if some parameter of an effect is free or not at its neutral value."""
        items = self.effect_values(effect, [*self.parameters.values()])
        return any(
            item.free or (item.neutral is not None and not item.is_neutral) for item in items
        )

    @cached_property
    def present_effects(self) -> tuple[Effect, ...]:
        """Effects with a free parameter or one not at its neutral value, in order."""
        return tuple(effect for effect in self.effects if self.is_present(effect))

    @property
    def law(self) -> Effect | None:
        """The model's law of thrust against distance, or None."""
        return next((e for e in self.present_effects if e.distance_law is not None), None)

    @property
    def nearest_z_over_R(self) -> float:
        """Minimum z/R at which the model's law is valid."""
        return self._discs.nearest_z_over_R

    def flow(self, conditions: Conditions, values: Any) -> Flow:
        """Return the input of the hooks for m samples, with heights and images.

        Effects between pulse width and speed apply only to speeds that were not measured. `values`
        are all parameters (n_parameters, ...), real or complex, broadcastable against (m,).
        """
        rig = self.rig
        n = rig.n_discs
        x, y = rig.disc_positions_m[:, 0], rig.disc_positions_m[:, 1]
        squares = np.zeros((n, len(conditions)))
        for rotor, disc in enumerate(rig.disc_of_rotor):
            squares[disc] += conditions.speed_rad_s[rotor] ** 2
        active = (squares > 0.0).astype(float)
        p = self.numbers(values)
        plane = self.plate_plane(conditions, p)
        flow = Flow(
            radius_m=values[self._index["R_m"]],
            position_x_m=x,
            position_y_m=y,
            height_m=[height_over(plane, x[i], y[i]) for i in range(n)],
            coverage=list(conditions.coverage),
            active=active,
            speed_rad_s=list(np.sqrt(squares)),
            neighbour_images=[0.0] * n,
            body_images=[0.0] * n,
            body_weight=0.0,
            voltage_V=conditions.voltage_V,
            elapsed_s=conditions.elapsed_s,
            time_s=conditions.time_s,
            load_direction=conditions.load_direction,
            plate_x_m=conditions.plate_x_m,
            airspeed_m_s=conditions.airspeed_m_s,
            plane=plane,
            moved_s=conditions.moved_s,
            moved_direction=conditions.moved_direction,
            past_load=tuple(conditions.past_load),
            past_wash=tuple(conditions.past_wash),
        )
        if not conditions.speed_measured:
            flow = flow._replace(speed_rad_s=self._discs.speeds(flow, p))
        full_flow: Flow = self._discs.with_images(flow, rig.disc_distances_m, self.body_images, p)
        if conditions.speed_measured:
            return full_flow
        return full_flow._replace(speed_rad_s=self.speeds_near_plate(full_flow, values))

    def speeds_near_plate(self, flow: Flow, values: Any) -> list[Quantity]:
        """Return the speeds (n_discs, ...) at the pulse widths of a flow's free speeds: rad/s.

        The flow's speeds are those out of ground effect. They are returned unchanged without motor
        data and for a governed speed.
        """
        slope = self.motor_slope_Nm_s
        if slope is None:
            return list(flow.speed_rad_s)
        c, counts = self.rig.propulsion.drag_coefficient_Nm_s2, self.rig.rotors_on_disc
        discs = zip(flow.speed_rad_s, self.drag_factors(flow, values), counts, strict=True)
        return [
            np.sqrt(n) * speed_near_plate(w / np.sqrt(n), c, factor, slope)
            for w, factor, n in discs
        ]

    def plate_plane(self, conditions: Conditions, p: tuple[Any, ...]) -> Plane:
        """Return the plane of the plate for the parameters `p` of the present effects."""
        tilt_rad = conditions.plate_tilt_rad + self._discs.tilt(p)
        plane: Plane = plate_plane(conditions.plate_z_m, conditions.plate_x_m, tilt_rad)
        return plane

    @cached_property
    def lag_s(self) -> float:
        """Time constant of rotor speed; 0 without a lag: s."""
        return sum(float(x) for x in self._call_without_flow("lag_s", at_most_one=True))

    @cached_property
    def delay_s(self) -> float:
        """Delay between a command and its arrival at the motors: s."""
        return sum(float(x) for x in self._call_without_flow("delay_s"))

    @cached_property
    def random_torque(self) -> tuple[float, float] | None:
        """Standard deviation (N m) and correlation time (s) of a random torque, or None."""
        return next(iter(self._call_without_flow("random_torque", at_most_one=True)), None)

    @cached_property
    def play_N(self) -> float:
        """Half width of the backlash model of a simulated load cell: N."""
        return sum(float(x) for x in self._call_without_flow("play_N"))

    def _call_without_flow(self, hook: str, *, at_most_one: bool = False) -> list[Any]:
        """Return the values of a hook that needs no flow, for all present effects that have it."""
        effects = [effect for effect in self.present_effects if getattr(effect.hooks, hook)]
        if at_most_one and len(effects) > 1:
            raise InputError(
                f"effects {effects[0].name!r} and {effects[1].name!r} of model {self.name!r} both "
                f"have the hook {hook}; remove one"
            )
        values = self.parameters.values_array()
        return [
            getattr(effect.hooks, hook)(
                effect.build_p(*self.effect_values(effect, values)), 0, NO_FLOW
            )
            for effect in effects
        ]

    def numbers(self, values: Any) -> tuple[Any, ...]:
        """Return the parameter values of the present effects, `p` of the combined functions."""
        return tuple(values[index] for index in self._effect_indices)

    @cached_property
    def _effect_indices(self) -> tuple[int, ...]:
        indices = range(len(self.parameters))
        return tuple(
            index
            for effect in self.present_effects
            for index in self.effect_values(effect, indices)
        )

    @cached_property
    def _discs(self) -> DiscThrust:
        return disc_thrust(self.present_effects, self.rig.n_discs, self.image_rules)

    @cached_property
    def _thrust_reading(self) -> Hook:
        return chain_hooks(bound_hooks(self.present_effects, "thrust_reading"))

    @cached_property
    def body_images(self) -> BodyImages:
        """Sources of the body term of eq. (4)."""
        x_m, y_m = self.rig.disc_positions_m.T
        return body_images(x_m, y_m, self.body_distance, self.rig.body.half_diagonal_m)

    @cached_property
    def image_rules(self) -> ImageRules:
        """Rules for sums of images."""
        return ImageRules(self.wake_rule, self.tilt_rule, len(self.body_images.arm_m))

    def disc_factors(self, flow: Flow, values: Any) -> tuple[Quantity, ...]:
        """Return T_IGE/T_OGE of each disc (n_discs, ...), including factors of effects."""
        n = len(flow.height_m)  # equal discs of a precomputed flow are merged
        discs = disc_thrust(self.present_effects, n, self.image_rules)
        factors: tuple[Quantity, ...] = discs.factors(flow, self.numbers(values))
        return factors

    @cached_property
    def is_torque_driven(self) -> bool:
        """True if a present effect changes the rotors' torque near a surface."""
        return any(effect.hooks.drag is not None for effect in self.present_effects)

    @cached_property
    def motor_slope_Nm_s(self) -> float | None:
        """Torque per speed of the motors; None if speed at a pulse width is independent of z."""
        return torque_per_speed(self.rig.motor) if self.is_torque_driven else None

    def drag_factors(self, flow: Flow, values: Any) -> tuple[Quantity, ...]:
        """Return the ratio of each disc's drag torque to its OGE value at equal speed."""
        n, p = len(flow.height_m), self.numbers(values)
        discs = disc_thrust(self.present_effects, n, self.image_rules)
        return tuple(discs.drags(discs.image_factors(flow, p), flow, p))

    def thrust_N(self, conditions: Conditions, values: Any = None) -> Any:
        """Return the load cell's settled reading (..., m): N.

        `values` as in `flow`; default: those of the model.
        """
        values = self.parameters.values_array() if values is None else values
        return self.reading_N(self.flow(conditions, values), values)

    def squared_speed(self, flow: Flow, values: Any) -> Any:
        """Return the sum over discs of w^2 times the thrust factor (..., m): thrust over k."""
        total: Quantity = 0.0
        for speed, factor in zip(flow.speed_rad_s, self.disc_factors(flow, values), strict=True):
            total = total + speed * speed * factor
        return total

    def reading_N(self, flow: Flow, values: Any) -> Any:
        """Return the load cell's settled reading for a flow with images (..., m): N."""
        reading = values[self._index["k"]] * self.squared_speed(flow, values)
        return self._thrust_reading(0, reading, flow, self.numbers(values))

    def predict(
        self, z_over_R: Any, *, speed_rad_s: Any = 1.0, tilt_rad: Any = 0.0, coverage: Any = 1.0
    ) -> Array:
        """Return T_IGE/T_OGE of each disc at equal rotor speed (n_discs, m).

        Args:
            z_over_R: plate distance from the centre of the rotors along their axis, over R (m,).
            speed_rad_s: of each rotor (n_rotors,); 0 for a stopped rotor.
            tilt_rad: of the plate (m,).
            coverage: fraction of each disc over the plate (n_discs,).
        """
        rig, values = self.rig, self.parameters.values_array()
        conditions = Conditions.build(
            rig, speed_rad_s=np.broadcast_to(speed_rad_s, rig.n_rotors), plate_tilt_rad=tilt_rad,
            plate_z_m=np.asarray(z_over_R) * rig.propulsion.radius_m,
            coverage=np.broadcast_to(coverage, rig.n_discs)[:, None],
        )  # fmt: skip
        return np.array(self.disc_factors(self.flow(conditions, values), values))

    def z_over_R(self, conditions: Conditions) -> Array:
        """Return the minimum distance of all running discs over the rig's rotor radius (m,)."""
        flow = self.flow(conditions, self.parameters.values_array())
        heights = np.array([np.broadcast_to(h, (len(conditions),)) for h in flow.height_m])
        heights = np.where(np.asarray(flow.active) > 0.0, heights, np.inf)
        z_over_R: Array = heights.min(axis=0) / self.rig.propulsion.radius_m
        return z_over_R
