"""Virtual rotor bench: motors, plate and load cell with imperfections, without protocol.

Time advances in stream ticks, only in `advance`. The readings of a seed do not depend on how the
ticks are split into calls: runs are repeatable, and a long settling costs one call.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchtool.core.channel import Channel
from benchtool.core.errors import InputError
from benchtool.core.rig import Rig
from benchtool.core.schedule import due_ticks
from benchtool.core.units import Array, from_si
from benchtool.physics.conditions import Conditions, plate_coverage
from benchtool.physics.disc_thrust import bound_hooks
from benchtool.physics.effects.effect import NO_FLOW
from benchtool.physics.fold import chain_hooks
from benchtool.physics.model import Model
from benchtool.simulate.imperfections import (
    FAMILIES,
    TILT_FEED_RAD_S,
    Axis,
    BacklashState,
    Imperfections,
    LoadCell,
    Reader,
)
from benchtool.simulate.powertrain import Powertrain, SpeedChange

SLOW_HZ = 10.0  # rate of ESC temperature readings, as telemetry of hobby ESCs; assumed
FIRST_TARE_S = 0.2  # readings collected before the first tare, where there are none
MAX_CLAMP_Z_OVER_R = 4.0  # beyond it no tilt or offset brings a disc near the validity limit


def list_channels(n_rotors: int) -> tuple[Channel, ...]:
    """Return the channels of a virtual bench, in stream order."""
    numbers = range(1, n_rotors + 1)
    return (
        *(Channel(f"pwm{i}_us", "pwm_us", f"commanded pulse width of motor {i}") for i in numbers),
        *(Channel(f"rpm{i}", "rpm", f"speed of rotor {i}") for i in numbers),
        Channel("thrust_N", "N", "thrust of the whole vehicle since the tare"),
        Channel("thrust_raw", "count", "load-cell counts, never tared"),
        Channel("torque_Nm", "N m", "reaction torque about the vertical axis"),
        Channel("plate_z_m", "m", "distance of the plate below the rotors"),
        Channel("plate_x_m", "m", "lateral position of the plate's centre"),
        Channel("plate_tilt_deg", "deg", "inclination of the plate"),
        Channel("voltage_V", "V", "battery voltage"),
        Channel("current_A", "A", "battery current"),
        Channel("temperature_degC", "degC", "ESC temperature"),
    )


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

    def thrust_N(self, position: PlatePosition, **numbers: Any) -> Array:
        """Return the reading (m,): N, for further numbers of `Conditions.build`.

        Samples must be in order, because hysteresis has a state.
        """
        conditions, n_clamped = self._clamp_distance(self._conditions(position, **numbers))
        self.clamped += n_clamped
        if self._play is not None:
            bare_N = self._bare.thrust_N(conditions)
            conditions = replace(conditions, load_direction=self._play.follow(bare_N))
        thrust_N: Array = self._truth.thrust_N(conditions, self._values)
        return thrust_N

    def drag_factors(self, speed_rad_s: Array, position: PlatePosition) -> Array:
        """Return the drag torque of each rotor relative to OGE (n,), for a position (1,)."""
        conditions = self._conditions(position, speed_rad_s=speed_rad_s[:, None], voltage_V=1.0)
        flow = self._truth.flow(self._clamp_distance(conditions)[0], self._values)
        return np.ravel(self._truth.drag_factors(flow, self._values))[self._rig.disc_of_rotor]

    def at_rest_N(self, position: PlatePosition, elapsed_s: float, time_s: float) -> float:
        """Return the reading of the model with all rotors at rest, `elapsed_s` after a tare."""
        unloaded = self._conditions(
            position, speed_rad_s=np.zeros((self._rig.n_rotors, 1)), elapsed_s=elapsed_s,
            time_s=time_s, load_direction=-1.0,
        )  # fmt: skip
        return float(self._truth.thrust_N(unloaded, self._values)[0])

    def _conditions(self, position: PlatePosition, **numbers: Any) -> Conditions:
        return Conditions.build(
            self._rig,
            plate_z_m=position.z_m,
            plate_x_m=position.x_m,
            plate_tilt_rad=position.tilt_rad,
            coverage=self._coverage(position.x_m),
            **numbers,
        )

    def _coverage(self, x_m: Array) -> Array:
        """Return the covered fractions (n_discs, m), or (n_discs, 1) for a plate at rest."""
        if np.any(x_m != x_m[0]):
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


class PlateBench:
    """Rotor bench over a movable plate; a `bench.firmware.Plant`."""

    def __init__(
        self,
        rig: Rig,
        truth: Model,
        rng: np.random.Generator,
        imperfections: Imperfections | None = None,
        rate_Hz: float = 200.0,
    ) -> None:
        self.rig = rig
        self.channels = list_channels(rig.n_rotors)
        resolved = (Imperfections() if imperfections is None else imperfections).resolve(rig)
        self._rng = rng
        if any(effect.hooks.lag_s is not None for effect in truth.effects):
            resolved = replace(resolved, motor_lag_s=truth.lag_s)
        self._powertrain = Powertrain(rig, resolved, speed_change(truth))
        self._supply_loss = sum(
            truth.parameters[f"{effect.name}.{effect.supply_loss}"].value
            for effect in truth.effects
            if effect.supply_loss
        )
        plate = rig.plate
        self._z = Axis(plate.speed_m_s, plate.z_park_m, resolved.backlash_m)
        self._x = Axis(plate.speed_m_s, 0.0)
        self._tilt = Axis(TILT_FEED_RAD_S, 0.0)
        self._thrust = TrueThrust(rig, truth)
        self.nearest_z_over_R = truth.nearest_z_over_R
        self._drags = truth.is_torque_driven
        self._cell = LoadCell(resolved, rig.limits.load_cell_rating_N)
        self._vibration_N = resolved.vibration_N
        torque = rig.sensors.get("torque_Nm")
        self._readers = {
            **{
                quantity: Reader(
                    getattr(resolved, f"{quantity}_noise_{unit}"),
                    getattr(resolved, f"{quantity}_quantum_{unit}"),
                    rig.sensors[family].rate_Hz if family in rig.sensors else 0.0,
                )
                for family, quantity, unit in FAMILIES
            },
            "torque": Reader(torque.noise, torque.quantum, torque.rate_Hz) if torque else Reader(),
            "temperature": Reader(0.0, 0.1 if resolved.esc_heating_K else 0.0, SLOW_HZ),
        }
        self._time_s = 0.0
        self._tared_s = 0.0
        self._tick = 0
        self.set_rate(rate_Hz)

    @property
    def rate_Hz(self) -> float:
        """Stream ticks per second."""
        return self._rate_Hz

    @property
    def count_N(self) -> float:
        """Force per count of `thrust_raw`: N."""
        return self._cell.count_N

    @property
    def clamped_readings(self) -> int:
        """Number of load-cell readings with the plate clamped to `nearest_z_over_R`."""
        return self._thrust.clamped

    @property
    def channel_rates_Hz(self) -> tuple[float, ...]:
        """Sampling rate of each channel (c,): Hz, at most the stream rate."""
        readers = {family: quantity for family, quantity, _ in FAMILIES}
        readers |= {"torque_Nm": "torque", "temperature_degC": "temperature"}
        rates = {name: self._readers[reader].rate_Hz for name, reader in readers.items()}
        rates |= {"thrust_N": self._cell.rate_Hz, "thrust_raw": self._cell.rate_Hz}
        families = [channel.name.rstrip("0123456789") for channel in self.channels]
        return tuple(min(rates.get(name, 0.0) or np.inf, self._rate_Hz) for name in families)

    @property
    def time_s(self) -> float:
        """Time since power-on."""
        return self._time_s + self._tick / self._rate_Hz

    @property
    def plate_moving(self) -> bool:
        """True while the plate moves."""
        return self._z.moving or self._x.moving or self._tilt.moving

    def set_rate(self, rate_Hz: float) -> None:
        """Change the stream rate from the next tick on."""
        if not 0.0 < rate_Hz <= 1e6:
            raise InputError(
                f"stream rate {rate_Hz:g} Hz is out of range; allowed: above 0, up to 1e6 Hz"
            )
        self._time_s = self.time_s if self._tick else self._time_s
        self._tick = 0
        self._rate_Hz = float(rate_Hz)
        self._powertrain.restart_hold()

    def command_pwm(self, pwm_us: Array) -> None:
        """Set the pulse width of every motor (n,): us, from the next tick on."""
        self._powertrain.pwm_us = np.array(pwm_us, float)

    def command_plate(self, z_m: float, x_m: float = 0.0, tilt_rad: float = 0.0) -> None:
        """Start moving the plate to a position."""
        self._z.target, self._x.target, self._tilt.target = z_m, x_m, tilt_rad

    def halt_plate(self) -> None:
        """Stop the plate at its present position."""
        for axis in (self._z, self._x, self._tilt):
            axis.target = axis.reported

    def tare(self) -> None:
        """Set the mean of the last conversions as zero thrust, which removes offset and creep."""
        if not self._cell.has_read:
            self.advance(max(1, round(self._rate_Hz * FIRST_TARE_S)))
        ones = np.ones(1)
        position = PlatePosition(self._z.true * ones, self._x.true * ones, self._tilt.true * ones)
        time_s = self.time_s
        self._cell.tare(
            self._thrust.at_rest_N(position, time_s - self._tared_s, time_s),
            self._thrust.at_rest_N(position, 0.0, time_s),
        )
        self._tared_s = time_s

    def advance(self, n: int) -> Array:
        """Return the next n ticks (n, c) in the order of `channels`; nan means no new value."""
        tick_s = 1.0 / self._rate_Hz
        elapsed_s = np.arange(1, n + 1, dtype=np.float64) * tick_s
        z_m, true_z_m = self._z.advance(elapsed_s)
        x_m, true_x_m = self._x.advance(elapsed_s)
        tilt_rad, true_tilt_rad = self._tilt.advance(elapsed_s)
        positions = PlatePosition(true_z_m, true_x_m, true_tilt_rad)

        def drag(speed_rad_s: Array, tick: int) -> Array:
            position = PlatePosition(*(part[tick : tick + 1] for part in positions))
            return self._thrust.drag_factors(speed_rad_s, position)

        run = self._powertrain.advance(n, tick_s, drag if self._drags else None)
        n_rotors = self.rig.n_rotors
        # One row of draws per tick, so that the noise does not depend on the split into calls.
        noise = self._rng.standard_normal((n, n_rotors + 6)).T
        time_s = self._time_s + (self._tick * tick_s + elapsed_s)
        is_converted = self._due(self._cell.rate_Hz, n)
        zero_N = self._cell.drifting_zero_N(time_s, tick_s, noise[0])[is_converted]
        thrust_N, thrust_raw = np.full((2, n), np.nan)
        if is_converted.any():  # most blocks of one tick have no new thrust
            position = PlatePosition(*(part[is_converted] for part in positions))
            speed, angle_rad, _, voltage_V, *_ = (part[..., is_converted] for part in run)
            at_s = time_s[is_converted]
            force_N = self._thrust.thrust_N(
                position, speed_rad_s=speed, voltage_V=voltage_V, elapsed_s=at_s - self._tared_s,
                time_s=at_s,
            )  # fmt: skip
            relative_speed = speed / self._powertrain.top_speed_rad_s
            vibration = np.sum(relative_speed**2 * np.sin(angle_rad), axis=0)
            force_N = force_N + self._vibration_N * vibration
            thrust_N[is_converted], thrust_raw[is_converted] = self._cell.convert(
                force_N + zero_N, noise[1][is_converted]
            )

        rows = np.empty((n, len(self.channels)))
        rows[:, :n_rotors] = self._powertrain.pwm_us
        rows[:, n_rotors : 2 * n_rotors] = self._rpm(run.speed_rad_s, noise[6:]).T
        spins = np.array([rotor.spin for rotor in self.rig.rotors], float)
        torque = self.rig.propulsion.drag_coefficient_Nm_s2 * (
            -spins @ (run.drag * run.speed_rad_s**2)
        )
        rows[:, 2 * n_rotors :] = np.column_stack(
            [
                thrust_N,
                thrust_raw,
                self._reading("torque", torque, noise[2]),
                self._reading("plate", z_m, noise[3]),
                x_m,
                from_si(tilt_rad, "deg"),
                # The effect itself reduces the speeds.
                self._reading(
                    "voltage", run.voltage_V * (1.0 - self._supply_loss * time_s), noise[4]
                ),
                self._reading("current", run.current_A, noise[5]),
                self._reading("temperature", run.temperature_degC, noise[5]),
            ]
        )
        self._tick += n
        return rows

    def _due(self, rate_Hz: float, n: int) -> NDArray[np.bool_]:
        """Return which of the next ticks (n,) have a new reading of a sensor."""
        return due_ticks(self._tick + 1, n, rate_Hz, self._rate_Hz)

    def _rpm(self, speed_rad_s: Array, noise: Array) -> Array:
        """Return the speed readings (n, m): rpm; a rotor at rest reads zero."""
        reader = self._readers["rpm"]
        reading = np.maximum(reader.read(from_si(speed_rad_s, "rpm"), noise), 0.0)
        reading[speed_rad_s == 0.0] = 0.0
        reading[:, ~self._due(reader.rate_Hz, reading.shape[1])] = np.nan
        return reading

    def _reading(self, name: str, true: Array, noise: Array) -> Array:
        reader = self._readers[name]
        reading = np.array(reader.read(true, noise))
        reading[~self._due(reader.rate_Hz, len(true))] = np.nan
        return reading
