"""The virtual rotor bench: motors, plate and load cell with their imperfections, no protocol.

Time passes in stream ticks and only in `advance`. However a span is split into calls, the same
seed gives the same readings, so a run can be repeated and a long settling costs one call.
"""

from __future__ import annotations

import numpy as np

from benchtool.core.array_type import Array
from benchtool.core.channel import Channel
from benchtool.core.errors import InputError
from benchtool.core.rig import Rig
from benchtool.core.units import from_si
from benchtool.physics.model import Model
from benchtool.simulate.imperfections import (
    FAMILIES,
    TILT_FEED_RAD_S,
    Axis,
    Imperfections,
    LoadCell,
    Reader,
)
from benchtool.simulate.powertrain import Battery, MotorTicks, Powertrain
from benchtool.simulate.true_thrust import PlatePosition, TrueThrust, motor_lag_s, speed_change

SLOW_HZ = 10.0  # rate of ESC temperature readings, as telemetry of hobby ESCs; assumed


FIRST_TARE_S = 0.2  # a cell that has read nothing yet is given this long before its first tare


def channels_of(n_rotors: int) -> tuple[Channel, ...]:
    """Return what a virtual bench of so many rotors streams, in order."""
    numbers = range(1, n_rotors + 1)
    return (
        *(Channel(f"pwm{i}_us", "pwm_us", f"commanded pulse of motor {i}") for i in numbers),
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


class PlateBench:
    """Be a rotor bench over a movable plate; a `bench.firmware.Plant`."""

    def __init__(
        self,
        rig: Rig,
        truth: Model,
        rng: np.random.Generator,
        imperfections: Imperfections | None = None,
        rate_Hz: float = 200.0,
    ) -> None:
        self.rig = rig
        self.channels = channels_of(rig.n_rotors)
        flaws = (Imperfections() if imperfections is None else imperfections).on(rig)
        self._rng = rng
        self._powertrain = Powertrain(
            rig.propulsion,
            rig.n_rotors,
            Battery(
                rig.propulsion.voltage_nominal_V + flaws.battery_excess_V,
                flaws.battery_drop_V_per_Ah,
                flaws.battery_resistance_ohm,
            ),
            motor_lag_s(truth, flaws.motor_lag_s),
            flaws.esc_heating_K,
            flaws.esc_time_s,
            speed_change(truth),
            rig.motor,
        )
        self._supply_loss = sum(
            truth.parameters[f"{effect.name}.{effect.supply_loss}"].value
            for effect in truth.effects
            if effect.supply_loss
        )
        plate = rig.plate
        self._z = Axis(plate.speed_m_s, plate.z_park_m, flaws.backlash_m)
        self._x = Axis(plate.speed_m_s, 0.0)
        self._tilt = Axis(TILT_FEED_RAD_S, 0.0)
        self._thrust = TrueThrust(rig, truth)
        self.nearest_z_over_R = truth.nearest_z_over_R
        self._drags = truth.is_torque_driven
        self._cell = LoadCell(flaws, rig.limits.load_cell_rating_N)
        self._vibration_N = flaws.vibration_N
        torque = rig.sensors.get("torque_Nm")
        self._readers = {
            **{
                quantity: Reader(
                    getattr(flaws, f"{quantity}_noise_{unit}"),
                    getattr(flaws, f"{quantity}_quantum_{unit}"),
                    rig.sensors[family].rate_Hz if family in rig.sensors else 0.0,
                )
                for family, quantity, unit in FAMILIES
            },
            "torque": Reader(torque.noise, torque.quantum, torque.rate_Hz) if torque else Reader(),
            "temperature": Reader(0.0, 0.1 if flaws.esc_heating_K else 0.0, SLOW_HZ),
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
        """Force of one count of `thrust_raw`: N."""
        return self._cell.count_N

    @property
    def clamped_readings(self) -> int:
        """How many load-cell readings took a plate nearer than `nearest_z_over_R` as there."""
        return self._thrust.clamped

    @property
    def channel_rates_Hz(self) -> tuple[float, ...]:
        """How often each channel has a new value (c,): Hz, at most the stream rate."""
        own = {family: quantity for family, quantity, _ in FAMILIES}
        own |= {"torque_Nm": "torque", "temperature_degC": "temperature"}
        rates = {name: self._readers[reader].rate_Hz for name, reader in own.items()}
        rates |= {"thrust_N": self._cell.rate_Hz, "thrust_raw": self._cell.rate_Hz}
        families = [channel.name.rstrip("0123456789") for channel in self.channels]
        return tuple(min(rates.get(name, 0.0) or np.inf, self._rate_Hz) for name in families)

    @property
    def time_s(self) -> float:
        """Time since power-on."""
        return self._time_s + self._tick / self._rate_Hz

    @property
    def pwm_us(self) -> Array:
        """Present pulse of every motor (n,): us."""
        return self._powertrain.pwm_us.copy()

    @property
    def plate_moving(self) -> bool:
        """Whether the plate is on its way."""
        return self._z.moving or self._x.moving or self._tilt.moving

    def set_rate(self, rate_Hz: float) -> None:
        """Change the stream rate from the next tick on."""
        if not 0.0 < rate_Hz <= 1e6:
            raise InputError(f"a stream rate of {rate_Hz:g} Hz is not possible; ask for 1 to 1000")
        self._time_s = self.time_s if self._tick else self._time_s
        self._tick = 0
        self._rate_Hz = float(rate_Hz)
        self._powertrain.restart_hold()

    def command_pwm(self, pwm_us: Array) -> None:
        """Take the pulse of every motor (n,): us, from the next tick on."""
        self._powertrain.pwm_us = np.array(pwm_us, float)

    def command_plate(self, z_m: float, x_m: float = 0.0, tilt_rad: float = 0.0) -> None:
        """Send the plate on its way to a position."""
        self._z.target, self._x.target, self._tilt.target = z_m, x_m, tilt_rad

    def halt_plate(self) -> None:
        """Halt the plate where it is."""
        for axis in (self._z, self._x, self._tilt):
            axis.target = axis.shown

    def tare(self) -> None:
        """Take the mean of the last conversions as zero thrust; offset and creep so far go away."""
        if not self._cell.has_read:
            self.advance(max(1, round(self._rate_Hz * FIRST_TARE_S)))
        one = np.ones(1)
        place = PlatePosition(self._z.true * one, self._x.true * one, self._tilt.true * one)
        time_s = self.time_s
        self._cell.tare(
            self._thrust.at_rest_N(place, time_s - self._tared_s, time_s),
            self._thrust.at_rest_N(place, 0.0, time_s),
        )
        self._tared_s = time_s

    def advance(self, n: int) -> Array:
        """Return the next n ticks (n, c) in the order of `channels`; nan where nothing is new."""
        tick_s = 1.0 / self._rate_Hz
        elapsed_s = np.arange(1, n + 1, dtype=np.float64) * tick_s
        z_m, true_z_m = self._z.advance(elapsed_s)
        x_m, true_x_m = self._x.advance(elapsed_s)
        tilt_rad, true_tilt_rad = self._tilt.advance(elapsed_s)
        whole = PlatePosition(true_z_m, true_x_m, true_tilt_rad)

        def drag(speed_rad_s: Array, tick: int) -> Array:
            here = PlatePosition(*(part[tick : tick + 1] for part in whole))
            return self._thrust.drag_factors(speed_rad_s, here)

        run = self._powertrain.advance(n, tick_s, drag if self._drags else None)
        rotors = self.rig.n_rotors
        # One row of draws per tick, so that splitting a span does not change its noise.
        white = self._rng.standard_normal((n, rotors + 6)).T
        time_s = self._time_s + (self._tick * tick_s + elapsed_s)
        fresh = self._cell.due(self._tick + 1, n, self._rate_Hz)
        zero_N = self._cell.wander_N(time_s, tick_s, white[0])[fresh]
        place = PlatePosition(*(part[fresh] for part in whole))
        force_N = self._force_N(
            MotorTicks(*(part[..., fresh] for part in run)), place, time_s[fresh]
        )
        thrust_N, thrust_raw = np.full(n, np.nan), np.full(n, np.nan)
        thrust_N[fresh], thrust_raw[fresh] = self._cell.convert(force_N + zero_N, white[1][fresh])

        block = np.empty((n, len(self.channels)))
        block[:, :rotors] = self._powertrain.pwm_us
        block[:, rotors : 2 * rotors] = self._rpm(run.speed_rad_s, white[6:]).T
        spins = np.array([place.spin for place in self.rig.rotors], float)
        torque = self.rig.propulsion.drag_coefficient_Nm_s2 * (
            -spins @ (run.drag * run.speed_rad_s**2)
        )
        block[:, 2 * rotors :] = np.column_stack(
            [
                thrust_N,
                thrust_raw,
                self._reading("torque", torque, white[2]),
                self._reading("plate", z_m, white[3]),
                x_m,
                from_si(tilt_rad, "deg"),
                # Speeds lose it by the effect itself.
                self._reading(
                    "voltage", run.voltage_V * (1.0 - self._supply_loss * time_s), white[4]
                ),
                self._reading("current", run.current_A, white[5]),
                self._reading("temperature", run.temperature_degC, white[5]),
            ]
        )
        self._tick += n
        return block

    def _force_N(self, run: MotorTicks, place: PlatePosition, time_s: Array) -> Array:
        """Return thrust and vibration on the cell (m,): N."""
        speed = run.speed_rad_s
        since_tare_s = time_s - self._tared_s
        thrust_N = self._thrust.thrust_N(speed, place, run.voltage_V, since_tare_s, time_s)
        relative = speed / self._powertrain.top_speed_rad_s
        shaking = np.sum(relative**2 * np.sin(run.angle_rad), axis=0)
        force_N: Array = thrust_N + self._vibration_N * shaking
        return force_N

    def _rpm(self, speed_rad_s: Array, white: Array) -> Array:
        """Return the speed readings (n, m): rpm; a rotor at rest reads zero."""
        reader = self._readers["rpm"]
        shown = np.maximum(reader.read(from_si(speed_rad_s, "rpm"), white), 0.0)
        shown[speed_rad_s == 0.0] = 0.0
        shown[:, ~reader.due(self._tick + 1, shown.shape[1], self._rate_Hz)] = np.nan
        return shown

    def _reading(self, name: str, true: Array, white: Array) -> Array:
        reader = self._readers[name]
        shown = np.array(reader.read(true, white))
        shown[~reader.due(self._tick + 1, len(true), self._rate_Hz)] = np.nan
        return shown
