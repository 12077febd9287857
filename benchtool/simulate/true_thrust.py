"""True thrust, motor lag and speed change of a virtual bench, from its model."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from benchtool.core.rig import Rig
from benchtool.core.units import Array
from benchtool.physics.conditions import Conditions, plate_coverage
from benchtool.physics.disc_thrust import bound_hooks
from benchtool.physics.effects.effect import NO_FLOW
from benchtool.physics.fold import chain_hooks
from benchtool.physics.model import Model
from benchtool.simulate.powertrain import SpeedChange

MAX_CLAMP_Z_OVER_R = 4.0  # beyond it no tilt or offset brings a disc near the validity limit


class PlatePosition(NamedTuple):
    """True position of the plate, (m,) each."""

    z_m: Array
    x_m: Array
    tilt_rad: Array


class TrueThrust:
    """Quasi-steady prediction of the load cell reading, sample by sample.

    Speeds change within a block; the steady formulae apply to the speeds of each sample. `clamped`
    counts samples with the plate nearer than the validity limit, which is used instead.
    """

    def __init__(self, rig: Rig, truth: Model) -> None:
        self.clamped = 0
        self._rig = rig
        self._truth = truth
        self._values = truth.parameters.values_array()
        self._covered: tuple[float, Array] | None = None
        half_N = truth.play_N
        for effect in truth.present_effects:
            if effect.hooks.play_N is not None:
                truth = truth.without(effect.name)
        self._bare, self._play = truth, BacklashState(half_N) if half_N > 0.0 else None

    def thrust_N(
        self,
        speed_rad_s: Array,
        position: PlatePosition,
        voltage_V: Array,
        elapsed_s: Array,
        time_s: Array,
    ) -> Array:
        """Return the reading (m,): N, for speeds (n_rotors, m) and times since tare and start.

        Samples must be in order, because hysteresis has a state.
        """
        conditions = self._conditions(speed_rad_s, position, voltage_V, elapsed_s, time_s)
        conditions, n_clamped = self._clamp_distance(conditions)
        self.clamped += n_clamped
        if self._play is not None:
            bare_N = self._bare.thrust_N(conditions)
            conditions = replace(conditions, load_direction=self._play.follow(bare_N))
        thrust_N: Array = self._truth.thrust_N(conditions, self._values)
        return thrust_N

    def drag_factors(self, speed_rad_s: Array, position: PlatePosition) -> Array:
        """Return the drag torque of each rotor relative to OGE (n,), for a position (1,)."""
        ones = np.ones(1)
        conditions = self._conditions(speed_rad_s[:, None], position, ones, 0.0 * ones, 0.0 * ones)
        flow = self._truth.flow(self._clamp_distance(conditions)[0], self._values)
        return np.ravel(self._truth.drag_factors(flow, self._values))[self._rig.disc_of_rotor]

    def at_rest_N(self, position: PlatePosition, elapsed_s: float, time_s: float) -> float:
        """Return the reading of the model with all rotors at rest, `elapsed_s` after a tare."""
        ones = np.ones(1)
        at_rest = np.zeros((self._rig.n_rotors, 1))
        nominal_V = self._rig.propulsion.voltage_nominal_V * ones
        conditions = self._conditions(at_rest, position, nominal_V, elapsed_s * ones, time_s * ones)
        unloaded = replace(conditions, load_direction=-ones)
        return float(self._truth.thrust_N(unloaded, self._values)[0])

    def _conditions(
        self,
        speed_rad_s: Array,
        position: PlatePosition,
        voltage_V: Array,
        elapsed_s: Array,
        time_s: Array,
    ) -> Conditions:
        return Conditions.build(
            self._rig,
            speed_rad_s=speed_rad_s,
            plate_z_m=position.z_m,
            plate_x_m=position.x_m,
            plate_tilt_rad=position.tilt_rad,
            coverage=self._coverage(position.x_m),
            voltage_V=voltage_V,
            elapsed_s=elapsed_s,
            time_s=time_s,
        )

    def _coverage(self, x_m: Array) -> Array:
        """Return the covered fractions (n_discs, m), or (n_discs, 1) for a plate at rest."""
        if not len(x_m) or np.any(x_m != x_m[0]):
            return plate_coverage(self._rig, x_m)
        # Cached: the areas are expensive, and the plate seldom moves sideways.
        if self._covered is None or self._covered[0] != x_m[0]:
            self._covered = float(x_m[0]), plate_coverage(self._rig, x_m[:1])
        return self._covered[1]

    def _clamp_distance(self, conditions: Conditions) -> tuple[Conditions, int]:
        """Return the conditions with the plate at the validity limit or farther, and the number of
        clamped samples.
        """
        radius_m = self._rig.propulsion.radius_m
        if np.all(conditions.plate_z_m > MAX_CLAMP_Z_OVER_R * radius_m):
            return conditions, 0
        missing_z_over_R = self._truth.nearest_z_over_R - self._truth.z_over_R(conditions)
        is_clamped = missing_z_over_R > 0.0
        if not is_clamped.any():
            return conditions, 0
        missing_m = np.where(is_clamped, missing_z_over_R, 0.0) * radius_m
        lift_m = missing_m / np.cos(conditions.plate_tilt_rad)
        lifted = replace(conditions, plate_z_m=conditions.plate_z_m + lift_m)
        return lifted, int(np.count_nonzero(is_clamped))


def speed_change(truth: Model) -> SpeedChange | None:
    """Return the speed change by the effects of the model; None if there is none."""
    hooks = bound_hooks(truth.present_effects, "speed")
    if not hooks:
        return None
    change, p = chain_hooks(hooks), truth.numbers(truth.parameters.values_array())
    positions_m = truth.rig.disc_positions_m[truth.rig.disc_of_rotor]

    def change_speeds(speed_rad_s: Array, voltage_V: float, time_s: float) -> Array:
        flow = NO_FLOW._replace(
            position_x_m=positions_m[:, 0], position_y_m=positions_m[:, 1],
            voltage_V=voltage_V, time_s=time_s,
        )  # fmt: skip
        return np.array([change(i, speed, flow, p) for i, speed in enumerate(speed_rad_s)])

    return change_speeds


class BacklashState:
    """State of a load cell with play of constant width, as caused by dry friction.

    The initial state is that after an unloading.
    """

    def __init__(self, half_width_N: float) -> None:
        self._half_N = half_width_N
        self._reading_N = half_width_N

    def follow(self, load_N: Array) -> Array:
        """Return the side (m,) of the play after each load: +1 from below, -1 from above.

        The reading of the load cell is the load minus side times half the width.
        """
        reading_N, half_N = self._reading_N, self._half_N
        side = np.empty(len(load_N))
        for row, load in enumerate(load_N.tolist()):
            reading_N = min(max(reading_N, load - half_N), load + half_N)
            side[row] = (load - reading_N) / half_N
        self._reading_N = reading_N
        return side
