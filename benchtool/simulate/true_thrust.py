"""What the model of a virtual bench decides: thrust, motor lag, what changes a pulse's speed."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from benchtool.core.array_type import Array
from benchtool.core.rig import Rig
from benchtool.physics.conditions import Conditions, plate_coverage
from benchtool.physics.disc_thrust import bound_hooks
from benchtool.physics.effects.effect import NO_FLOW
from benchtool.physics.fold import chained
from benchtool.physics.model import Model
from benchtool.simulate.powertrain import SpeedChange

OUT_OF_GROUND_EFFECT_Z_OVER_R = (
    4.0  # z/R beyond which no tilt or offset of a rig brings a disc near the limit
)


class PlatePosition(NamedTuple):
    """Where the plate truly stands, (m,) each."""

    z_m: Array
    x_m: Array
    tilt_rad: Array


class TrueThrust:
    """Predict what the load cell would settle to, sample by sample.

    Speeds change within a block; the settled formulae hold at each instant's speeds.
    `clamped` counts the samples for which the plate was nearer than the formulae reach and was
    taken as standing at that limit.
    """

    def __init__(self, rig: Rig, truth: Model) -> None:
        self.clamped = 0
        self._rig = rig
        self._truth = truth
        self._values = truth.parameters.values_array()
        self._covered: tuple[float, Array] | None = None
        self._bare, self._play = _behind_play(truth)

    def thrust_N(
        self,
        speed_rad_s: Array,
        place: PlatePosition,
        voltage_V: Array,
        elapsed_s: Array,
        time_s: Array,
    ) -> Array:
        """Return the reading (m,): N, for speeds (n_rotors, m) and times since tare and start.

        Samples must come in order: a load cell with hysteresis remembers.
        """
        given = self._conditions(speed_rad_s, place, voltage_V, elapsed_s, time_s)
        conditions, held = self._kept_valid(given)
        self.clamped += held
        if self._play is not None:
            bare_N = self._bare.thrust_N(conditions)
            conditions = replace(conditions, load_direction=self._play.follow(bare_N))
        thrust_N: Array = self._truth.thrust_N(conditions, self._values)
        return thrust_N

    def drag_factors(self, speed_rad_s: Array, place: PlatePosition) -> Array:
        """Return the drag torque of each rotor over that far away (n,), for a place (1,)."""
        one = np.ones(1)
        given = self._conditions(speed_rad_s[:, None], place, one, 0.0 * one, 0.0 * one)
        flow = self._truth.flow(self._kept_valid(given)[0], self._values)
        return np.ravel(self._truth.drag_factors(flow, self._values))[self._rig.disc_of_rotor]

    def at_rest_N(self, place: PlatePosition, elapsed_s: float, time_s: float) -> float:
        """Return the model's own reading with every rotor still, so long after a tare."""
        one = np.ones(1)
        still = np.zeros((self._rig.n_rotors, 1))
        nominal_V = self._rig.propulsion.voltage_nominal_V * one
        conditions = self._conditions(still, place, nominal_V, elapsed_s * one, time_s * one)
        unloaded = replace(conditions, load_direction=-one)
        return float(self._truth.thrust_N(unloaded, self._values)[0])

    def _conditions(
        self,
        speed_rad_s: Array,
        place: PlatePosition,
        voltage_V: Array,
        elapsed_s: Array,
        time_s: Array,
    ) -> Conditions:
        return Conditions.of(
            self._rig,
            speed_rad_s=speed_rad_s,
            plate_z_m=place.z_m,
            plate_x_m=place.x_m,
            plate_tilt_rad=place.tilt_rad,
            coverage=self._coverage(place.x_m),
            voltage_V=voltage_V,
            elapsed_s=elapsed_s,
            time_s=time_s,
        )

    def _coverage(self, x_m: Array) -> Array:
        """Return the covered fractions (n_discs, m), or (n_discs, 1) for a plate that stands."""
        if not len(x_m) or np.any(x_m != x_m[0]):
            return plate_coverage(self._rig, x_m)
        # The areas are costly, and the plate seldom moves sideways.
        if self._covered is None or self._covered[0] != x_m[0]:
            self._covered = float(x_m[0]), plate_coverage(self._rig, x_m[:1])
        return self._covered[1]

    def _kept_valid(self, conditions: Conditions) -> tuple[Conditions, int]:
        """Return the conditions with the plate no nearer than where the formulae hold.

        Returns:
            They, and for how many samples the plate was held there.
        """
        radius_m = self._rig.propulsion.radius_m
        if np.all(conditions.plate_z_m > OUT_OF_GROUND_EFFECT_Z_OVER_R * radius_m):
            return conditions, 0
        missing = self._truth.nearest_z_over_R - self._truth.z_over_R(conditions)
        near = missing > 0.0
        if not near.any():
            return conditions, 0
        lift_m = np.where(near, missing, 0.0) * radius_m / np.cos(conditions.plate_tilt_rad)
        lifted = replace(conditions, plate_z_m=conditions.plate_z_m + lift_m)
        return lifted, int(np.count_nonzero(near))


def _behind_play(truth: Model) -> tuple[Model, BacklashState | None]:
    """Return the model without hysteresis, and the play that it stands for."""
    half_N = truth.play_N
    for effect in truth.present_effects:
        if effect.hooks.play_N is not None:
            truth = truth.without(effect.name)
    return truth, BacklashState(half_N) if half_N > 0.0 else None


def motor_lag_s(truth: Model, otherwise_s: float) -> float:
    """Return the whole motor lag: the model's own where it states one."""
    stated = any(effect.hooks.lag_s is not None for effect in truth.effects)
    return truth.lag_s if stated else otherwise_s


def speed_change(truth: Model) -> SpeedChange | None:
    """Return how the model's own effects change the speed that a pulse gives, None for not."""
    hooks = bound_hooks(truth.present_effects, "speed")
    if not hooks:
        return None
    change, p = chained(hooks), truth.numbers(truth.parameters.values_array())
    places = truth.rig.disc_positions_m[truth.rig.disc_of_rotor]

    def changed(speed_rad_s: Array, voltage_V: float, time_s: float) -> Array:
        flow = NO_FLOW._replace(
            position_x_m=places[:, 0], position_y_m=places[:, 1], voltage_V=voltage_V, time_s=time_s
        )
        return np.array([change(i, speed, flow, p) for i, speed in enumerate(speed_rad_s)])

    return changed


class BacklashState:
    """Follow the side of a load behind a play of constant width, as dry friction makes it.

    It begins as after an unloading: a cell that has been loaded before.
    """

    def __init__(self, half_width_N: float) -> None:
        self._half_N = half_width_N
        self._shown_N = half_width_N

    def follow(self, load_N: Array) -> Array:
        """Return the side (m,) after each load in turn: +1 from below, -1 from above, or between.

        The load less side times half the width is what a cell behind the play shows.
        """
        shown_N, half_N = self._shown_N, self._half_N
        side = np.empty(len(load_N))
        for row, load in enumerate(load_N.tolist()):
            shown_N = min(max(shown_N, load - half_N), load + half_N)
            side[row] = (load - shown_N) / half_N
        self._shown_N = shown_N
        return side
