"""A model: a rig, the images of its rotors, and named effects that add.

The baseline is one rotor over the plate (eq. 2) with thrust k w^2 (eq. 8): parameters `k`
(thrust coefficient of one rotor), `R_m` (effective radius) and, where the vehicle turns,
`inertia_kgm2`. Everything else is an effect.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.parameter import Parameter, Parameters, Prior, full_name
from benchtool.core.rig import Rig
from benchtool.physics.body_lift import BodyDistance, body_images, centre_distances_m
from benchtool.physics.catalogue import effect_named
from benchtool.physics.conditions import Conditions
from benchtool.physics.effects.effect import Effect, Flow, Quantity
from benchtool.physics.images import neighbour_images, partial_factor, self_image, thrust_factor
from benchtool.physics.wake_rules import WAKE_RULES

Array = NDArray[np.float64]


INERTIA_KNOWN = 0.025
"""Standard error of an inertia over its value, where a model file states none: "known to 5 %" taken
for two standard errors; a guess."""


def baseline_parameters(rig: Rig) -> Parameters:
    """Return k, R_m, the pitch inertia and the two noise parameters at the rig's own values."""
    p = rig.propulsion
    return Parameters(
        (
            (
                "k",
                Parameter(
                    "k",
                    "N/(rad/s)2",
                    p.thrust_coefficient_N_s2,
                    lower=0.0,
                    description="thrust coefficient of one rotor out of ground effect (eq. 8)",
                    source=rig.sources.get("propulsion.thrust_coefficient_N_s2", ""),
                ),
            ),
            (
                "R_m",
                Parameter(
                    "R_m",
                    "m",
                    p.radius_m,
                    lower=0.1 * p.radius_m,
                    upper=3.0 * p.radius_m,
                    description="effective rotor radius in the image terms (eq. 2)",
                    source=rig.sources.get("propulsion.radius_m", ""),
                ),
            ),
            (
                "inertia_kgm2",
                Parameter(
                    "inertia_kgm2",
                    "kg m2",
                    rig.body.inertia_yy_kgm2,
                    lower=0.0,
                    prior=Prior(
                        "normal",
                        rig.body.inertia_yy_kgm2,
                        INERTIA_KNOWN * rig.body.inertia_yy_kgm2,
                        "assumed: worked out from parts, 5 % for two standard errors",
                    ),
                    description="moment of inertia about the pitch axis",
                    source=rig.sources.get("body.inertia_yy_kgm2", ""),
                ),
            ),
            (
                "noise.scale",
                Parameter(
                    "scale",
                    "1",
                    1.0,
                    lower=0.0,
                    description="factor on the stated standard errors",
                    source="1: the errors are taken as stated",
                ),
            ),
            (
                "noise.sd_N",
                Parameter(
                    "sd_N",
                    "N",
                    0.0,
                    lower=0.0,
                    description="scatter added in quadrature to the stated errors",
                    source="0: nothing is added",
                ),
            ),
        )
    )


@dataclass(frozen=True, kw_only=True)
class Model:
    """Predict what a bench reads.

    Attributes:
        name: as in files.
        rig: the vehicle or rotor on the bench.
        effects: in the order of the chain.
        parameters: baseline and effects, by full name ("R_m", "body_lift.K_b").
        wake_rule: how partly covered discs share the body term (`aero.wake_rules`).
        body_distance: which b eq. (4) uses: half the diagonal (as derived) or all of it (printed).
        description: one or two sentences.
        provenance: where the model came from.
    """

    name: str
    rig: Rig
    parameters: Parameters
    effects: tuple[Effect, ...] = ()
    wake_rule: str = "notes"
    body_distance: BodyDistance = "half_diagonal"
    description: str = ""
    provenance: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def single(cls, rig: Rig, name: str = "single") -> Model:
        """Return the baseline: eq. (2) for every rotor by itself."""
        return cls(name=name, rig=rig, parameters=baseline_parameters(rig))

    def __post_init__(self) -> None:
        if self.wake_rule not in WAKE_RULES:
            raise UnknownChoice("wake rule", self.wake_rule, WAKE_RULES)

    # --- building -------------------------------------------------------------------------

    def with_effect(self, effect: str | Effect, **values: float) -> Model:
        """Return the model with one more effect, its parameters at `values` or their defaults."""
        added = effect_named(effect) if isinstance(effect, str) else effect
        if any(present.name == added.name for present in self.effects):
            raise InputError(f"model {self.name!r} has the effect {added.name!r} already")
        known = {parameter.name: parameter for parameter in added.parameters}
        for name in values:
            if name not in known:
                raise UnknownChoice(f"parameter of effect {added.name!r}", name, known)
        new = [
            (f"{added.name}.{name}", item.at(values[name]) if name in values else item)
            for name, item in known.items()
        ]
        return replace(
            self,
            effects=(*self.effects, added),
            parameters=Parameters((*self.parameters.items(), *new)),
        )

    def without(self, name: str) -> Model:
        """Return the model with one effect taken out."""
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

    def at(self, parameters: Parameters) -> Model:
        """Return the model with these parameters in place of its own."""
        return replace(self, parameters=parameters)

    def freed(self, *names: str) -> Model:
        """Return the model with those parameters free and the others as they are.

        A name's last part is enough where no other parameter has it.
        """
        parameters = self.parameters
        for name in (full_name(each, self.parameters) for each in names):
            parameters = parameters.replaced(name, parameters[name].freed())
        return self.at(parameters)

    def fixed(self, name: str, value: float | None = None) -> Model:
        """Return the model with one parameter fixed, at `value` when given; named as in `freed`."""
        full = full_name(name, self.parameters)
        return self.at(self.parameters.replaced(full, self.parameters[full].fixed(value)))

    # --- predicting -----------------------------------------------------------------------

    @cached_property
    def _index(self) -> dict[str, int]:
        return {name: position for position, name in enumerate(self.parameters)}

    def effect_values(self, effect: Effect, values: Any) -> list[Any]:
        """Return the effect's own slice of `values` (n_parameters, ...), in its own order."""
        return [values[self._index[f"{effect.name}.{item.name}"]] for item in effect.parameters]

    def is_present(self, effect: Effect) -> bool:
        """Whether an effect can act: some parameter free or away from its neutral value."""
        own = [self.parameters[f"{effect.name}.{item.name}"] for item in effect.parameters]
        return any(item.free or (item.neutral is not None and not item.is_neutral) for item in own)

    @cached_property
    def present_effects(self) -> tuple[Effect, ...]:
        """The effects that can act, in order."""
        return tuple(effect for effect in self.effects if self.is_present(effect))

    def flow(self, conditions: Conditions, values: Any) -> Flow:
        """Return what the hooks see, heights and images worked out.

        Args:
            conditions: of m samples; effects between pulse and speed act only on speeds that were
                not measured.
            values: all parameters (n_parameters, ...), broadcastable against (m,).
        """
        rig = self.rig
        n = rig.n_discs
        x, y = rig.disc_positions_m[:, 0], rig.disc_positions_m[:, 1]
        squares = np.zeros((n, len(conditions)))
        for rotor, disc in enumerate(rig.disc_of_rotor):
            squares[disc] += conditions.speed_rad_s[rotor] ** 2
        active = (squares > 0.0).astype(float)
        cosine, sine = np.cos(conditions.plate_tilt_rad), np.sin(conditions.plate_tilt_rad)
        flow = Flow(
            radius_m=values[self._index["R_m"]],
            position_x_m=x,
            position_y_m=y,
            height_m=[conditions.plate_z_m * cosine - x[i] * sine for i in range(n)],
            area=list(conditions.coverage),
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
        )
        for effect in self.present_effects:
            p = self.effect_values(effect, values)
            flow = _changed(flow, effect, p, n)
            if not conditions.speed_measured:
                flow = _driven(flow, effect, p, n)
        return self._with_images(flow)

    def _with_images(self, flow: Flow) -> Flow:
        discs = range(self.rig.n_discs)
        arms = self.body_arms_m
        sources = [flow.area[j] * flow.active[j] for j in discs]
        heights, distances = flow.height_m, self.rig.disc_distances_m
        return flow._replace(
            neighbour_images=[neighbour_images(i, heights, sources, distances) for i in discs],
            body_images=[body_images(heights[i], arms) for i in discs],
            body_weight=WAKE_RULES[self.wake_rule].weight(sources),
        )

    @cached_property
    def body_arms_m(self) -> Array:
        """Return the distances from the body's centre to the images of eq. (4) (n_images,): m."""
        b = self.rig.body.half_diagonal_m
        places = self.rig.disc_positions_m if b is None else np.full((4, 2), b / np.sqrt(2.0))
        return centre_distances_m(places[:, 0], places[:, 1], self.body_distance)

    def disc_factors(self, flow: Flow, values: Any) -> list[Quantity]:
        """Return T_IGE/T_OGE of each disc (n_discs, ...), factors of effects included."""
        out = []
        for i in range(len(flow.height_m)):
            total = flow.radius_m * flow.radius_m * self_image(flow.height_m[i])
            factor: Quantity = 1.0
            for effect in self.present_effects:
                p = self.effect_values(effect, values)
                if effect.denominator is not None:
                    total = total + effect.denominator(i, flow, p)
                if effect.factor is not None:
                    factor = factor * effect.factor(i, flow, p)
            out.append(factor * partial_factor(thrust_factor(total), flow.area[i]))
        return out

    def thrust_N(self, conditions: Conditions, values: Any = None) -> Any:
        """Return what the load cell shows on a settled bench (..., m): N.

        Args:
            conditions: of m samples.
            values: all parameters (n_parameters, ...) broadcastable against (m,), real or complex;
                the model's own values when left out.
        """
        values = self.parameters.values_array() if values is None else values
        return self.reading_N(self.flow(conditions, values), values)

    def squared_speed(self, flow: Flow, values: Any) -> Any:
        """Return the sum over discs of w^2 times its factor (..., m): thrust over k."""
        total: Quantity = 0.0
        for speed, factor in zip(flow.speed_rad_s, self.disc_factors(flow, values), strict=True):
            total = total + speed * speed * factor
        return total

    def reading_N(self, flow: Flow, values: Any) -> Any:
        """Return the load cell's settled reading for a flow that is worked out (..., m): N."""
        reading = values[self._index["k"]] * self.squared_speed(flow, values)
        for effect in self.present_effects:
            if effect.thrust_reading is not None:
                p = self.effect_values(effect, values)
                states = [state.settled(0.0, flow.elapsed_s, p) for state in effect.states]
                reading = effect.thrust_reading(reading, flow, states, p)
        return reading

    def factor(self, conditions: Conditions, values: Any = None) -> Any:
        """Return T_IGE/T_OGE of the whole vehicle at equal rotor speeds (..., m).

        Sensor effects stand outside: this is the vehicle's factor, not the load cell's.
        """
        values = self.parameters.values_array() if values is None else values
        near = self.squared_speed(self.flow(conditions, values), values)
        far = self.squared_speed(self.flow(conditions.out_of_ground_effect(), values), values)
        return near / far

    def z_over_R(self, conditions: Conditions) -> Array:
        """Return the least distance of any turning disc over the rig's rotor radius (m,)."""
        flow = self.flow(conditions, self.parameters.values_array())
        heights = np.array([np.broadcast_to(h, (len(conditions),)) for h in flow.height_m])
        heights = np.where(np.asarray(flow.active) > 0.0, heights, np.inf)
        least: Array = heights.min(axis=0) / self.rig.propulsion.radius_m
        return least


def _changed(flow: Flow, effect: Effect, p: Sequence[Quantity], n: int) -> Flow:
    """Return the flow after an effect's changes of height and area."""
    if effect.height is not None:
        moved = [flow.height_m[i] + effect.height(i, flow, p) for i in range(n)]
        flow = flow._replace(height_m=moved)
    if effect.area is not None:
        areas = [effect.area(i, flow.area[i], flow, p) for i in range(n)]
        flow = flow._replace(area=areas)
    return flow


def _driven(flow: Flow, effect: Effect, p: Sequence[Quantity], n: int) -> Flow:
    """Return the flow after an effect's changes between the commanded and the settled speed."""
    if effect.speed is not None:
        speeds = [effect.speed(i, flow.speed_rad_s[i], flow, p) for i in range(n)]
        flow = flow._replace(speed_rad_s=speeds)
    for state in effect.states:
        if state.drive == "speed_rad_s":
            speeds = [state.settled(flow.speed_rad_s[i], flow.elapsed_s, p) for i in range(n)]
            flow = flow._replace(speed_rad_s=speeds)
    return flow
