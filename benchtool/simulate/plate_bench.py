"""The virtual rotor bench: motors, plate and load cell with their imperfections, no protocol.

Time passes in stream ticks and only in `advance`. However a span is split into calls, the same
seed gives the same readings, so a run can be repeated and a long settling costs one call.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchtool.aero.validity import VALIDITY_Z_OVER_R
from benchtool.core.channel import Channel
from benchtool.core.rig import Rig
from benchtool.core.units import from_si
from benchtool.effects.conditions import Conditions, plate_coverage
from benchtool.effects.effect import Flow
from benchtool.effects.model import Model
from benchtool.errors import InputError
from benchtool.simulate.battery import Battery
from benchtool.simulate.imperfections import Imperfections
from benchtool.simulate.plate_motion import TILT_FEED_RAD_S, Axis
from benchtool.simulate.powertrain import Powertrain, Run, SpeedChange
from benchtool.simulate.sensor import Reader

Array = NDArray[np.float64]

COUNT_TOP = 2**23
"""Counts of a 24-bit two's complement converter end here (HX711 data sheet, Avia Semiconductor)."""

RATING_COUNTS = 2**22
"""Counts at the cell's rating when no quantum is stated: 2 mV/V at 5 V over +-20 mV (gain 128)."""

TARE_READINGS = 16
"""A tare averages so many conversions: 0.2 s at 80 Hz; an assumption, common in HX711 code."""

SLOW_HZ = 10.0
"""Rate of ESC temperature readings; an assumption, telemetry of hobby ESCs is about as fast."""


WELL_CLEAR = 4.0
"""Plate distance over R beyond which no tilt or offset of a rig brings a disc near the limit."""


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
    """Be a rotor bench over a movable plate; a `bench.firmware.Plant`.

    `clamped_readings` counts the load-cell readings for which the plate was nearer than the
    formulae reach (z/R below 0.5) and was taken as standing at that limit. `count_N` is the force
    of one count of `thrust_raw`.

    Args:
        rig: geometry, propulsion, sensors, plate.
        truth: the model whose thrust the load cell shows.
        rng: source of every random number.
        imperfections: how far from perfect; numbers left open are the rig's.
        rate_Hz: stream ticks per second.
    """

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
        self._flaws = flaws
        self._truth = truth
        self._values = truth.parameters.values_array()
        self._rng = rng
        self._powertrain = Powertrain(
            rig.propulsion,
            rig.n_rotors,
            Battery(
                rig.propulsion.voltage_nominal_V + flaws.battery_excess_V,
                flaws.battery_drop_V_per_Ah,
                flaws.battery_resistance_ohm,
            ),
            _lag_s(truth, flaws),
            flaws.esc_heating_K,
            flaws.esc_time_s,
            _speed_change(truth),
        )
        plate = rig.plate
        self._z = Axis(plate.speed_m_s, plate.z_park_m, flaws.backlash_m)
        self._x = Axis(plate.speed_m_s, 0.0)
        self._tilt = Axis(TILT_FEED_RAD_S, 0.0)
        self.count_N = flaws.thrust_quantum_N or rig.limits.load_cell_rating_N / RATING_COUNTS
        self._readers = {
            "thrust": Reader(flaws.thrust_noise_N, 0.0, flaws.thrust_rate_Hz),
            "rpm": Reader(flaws.rpm_noise_rpm, flaws.rpm_quantum_rpm, self._rate_of("rpm")),
            "torque": self._plain("torque_Nm"),
            "plate": Reader(flaws.plate_noise_m, flaws.plate_quantum_m, self._rate_of("plate_z_m")),
            "voltage": Reader(
                flaws.voltage_noise_V, flaws.voltage_quantum_V, self._rate_of("voltage_V")
            ),
            "current": Reader(
                flaws.current_noise_A, flaws.current_quantum_A, self._rate_of("current_A")
            ),
            "temperature": Reader(0.0, 0.1 if flaws.esc_heating_K else 0.0, SLOW_HZ),
        }
        self.clamped_readings = 0
        self._covered: tuple[float, Array] | None = None
        self._zero_N = 0.0
        self._walk_N = 0.0
        self._carried_N = 0.0
        self._recent_N: Array = np.empty(0)
        self._time_s = 0.0
        self._tared_s = 0.0
        self._tick = 0
        self.set_rate(rate_Hz)

    @property
    def rate_Hz(self) -> float:
        """Stream ticks per second."""
        return self._rate_Hz

    @property
    def channel_rates_Hz(self) -> tuple[float, ...]:
        """How often each channel has a new value (c,): Hz, at most the stream rate."""
        own = {
            "rpm": "rpm",
            "thrust_N": "thrust",
            "thrust_raw": "thrust",
            "torque_Nm": "torque",
            "plate_z_m": "plate",
            "voltage_V": "voltage",
            "current_A": "current",
            "temperature_degC": "temperature",
        }
        readers = [own.get(channel.name.rstrip("0123456789")) for channel in self.channels]
        rates = [self._readers[name].rate_Hz if name else 0.0 for name in readers]
        return tuple(min(rate or self._rate_Hz, self._rate_Hz) for rate in rates)

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
        if not len(self._recent_N):
            self.advance(max(1, round(self._rate_Hz * TARE_READINGS / 80.0)))
        remains_N = self._at_rest_N(0.0)
        self._carried_N += self._at_rest_N(self.time_s - self._tared_s) - remains_N
        self._zero_N = float(np.mean(self._recent_N)) - remains_N
        self._tared_s = self.time_s

    def advance(self, n: int) -> Array:
        """Return the next n ticks (n, c) in the order of `channels`; nan where nothing is new."""
        tick_s = 1.0 / self._rate_Hz
        run = self._powertrain.advance(n, tick_s)
        elapsed_s = np.arange(1, n + 1, dtype=np.float64) * tick_s
        z_m, true_z_m = self._z.advance(elapsed_s)
        x_m, true_x_m = self._x.advance(elapsed_s)
        tilt_rad, true_tilt_rad = self._tilt.advance(elapsed_s)
        rotors = self.rig.n_rotors
        # One row of draws per tick, so that splitting a span does not change its noise.
        white = self._rng.standard_normal((n, rotors + 6)).T
        time_s = self._time_s + (self._tick * tick_s + elapsed_s)
        walk_N = self._walk_N + np.cumsum(white[0]) * (
            self._flaws.drift_walk_N_per_sqrt_s * np.sqrt(tick_s)
        )
        self._walk_N = float(walk_N[-1])

        fresh = self._readers["thrust"].due(self._tick + 1, n, self._rate_Hz)
        place = (true_z_m[fresh], true_x_m[fresh], true_tilt_rad[fresh])
        signal_N = self._signal_N(Run(*(part[..., fresh] for part in run)), place, time_s[fresh])
        counts = self._counts(signal_N + walk_N[fresh], white[1][fresh])
        thrust_raw, thrust_N = np.full(n, np.nan), np.full(n, np.nan)
        thrust_raw[fresh] = counts
        thrust_N[fresh] = counts * self.count_N - self._zero_N
        self._recent_N = np.concatenate([self._recent_N, counts * self.count_N])[-TARE_READINGS:]

        block = np.empty((n, len(self.channels)))
        block[:, :rotors] = self._powertrain.pwm_us
        block[:, rotors : 2 * rotors] = self._rpm(run.speed_rad_s, white[6:]).T
        spins = np.array([place.spin for place in self.rig.rotors], float)
        torque = self.rig.propulsion.drag_coefficient_Nm_s2 * (-spins @ run.speed_rad_s**2)
        block[:, 2 * rotors :] = np.column_stack(
            [
                thrust_N,
                thrust_raw,
                self._reading("torque", torque, white[2]),
                self._reading("plate", z_m, white[3]),
                x_m,
                from_si(tilt_rad, "deg"),
                self._reading("voltage", run.voltage_V, white[4]),
                self._reading("current", run.current_A, white[5]),
                self._reading("temperature", run.temperature_degC, white[5]),
            ]
        )
        self._tick += n
        return block

    def _signal_N(self, run: Run, place: tuple[Array, Array, Array], time_s: Array) -> Array:
        """Return the force on the cell (m,), with everything that is not white."""
        flaws = self._flaws
        speed = run.speed_rad_s
        thrust_N = self._thrust_N(speed, place, run.voltage_V, time_s - self._tared_s, time_s)
        relative = speed / self._powertrain.top_speed_rad_s
        shake_N = flaws.vibration_N * np.sum(relative**2 * np.sin(run.angle_rad), axis=0)
        creep_N = flaws.drift_N_per_s * time_s
        signal_N: Array = thrust_N + shake_N + creep_N + flaws.start_offset_N + self._carried_N
        return signal_N

    def _thrust_N(
        self,
        speed_rad_s: Array,
        place: tuple[Array, Array, Array],
        voltage_V: Array,
        elapsed_s: Array,
        time_s: Array,
    ) -> Array:
        z_m, x_m, tilt_rad = place
        conditions = Conditions.of(
            self.rig,
            speed_rad_s=speed_rad_s,
            plate_z_m=z_m,
            plate_tilt_rad=tilt_rad,
            coverage=self._coverage(x_m),
            voltage_V=voltage_V,
            elapsed_s=elapsed_s,
            time_s=time_s,
        )
        thrust_N: Array = self._truth.thrust_N(self._kept_valid(conditions), self._values)
        return thrust_N

    def _coverage(self, x_m: Array) -> Array:
        """Return the covered fractions (n_discs, m), or (n_discs, 1) for a plate that stands."""
        if not len(x_m) or np.any(x_m != x_m[0]):
            return plate_coverage(self.rig, x_m)
        # The areas are costly, and the plate seldom moves sideways.
        if self._covered is None or self._covered[0] != x_m[0]:
            self._covered = float(x_m[0]), plate_coverage(self.rig, x_m[:1])
        return self._covered[1]

    def _kept_valid(self, conditions: Conditions) -> Conditions:
        """Return the conditions with the plate no nearer than where the formulae hold."""
        radius_m = self.rig.propulsion.radius_m
        if np.all(conditions.plate_z_m > WELL_CLEAR * radius_m):
            return conditions
        missing = VALIDITY_Z_OVER_R - self._truth.z_over_R(conditions)
        near = missing > 0.0
        if not near.any():
            return conditions
        self.clamped_readings += int(np.count_nonzero(near))
        lift_m = np.where(near, missing, 0.0) * radius_m / np.cos(conditions.plate_tilt_rad)
        return replace(conditions, plate_z_m=conditions.plate_z_m + lift_m)

    def _at_rest_N(self, elapsed_s: float) -> float:
        """Return the model's own reading with the motors at rest, so long after a tare."""
        one = np.ones(1)
        parked = (self._z.true * one, self._x.true * one, self._tilt.true * one)
        nominal_V = self.rig.propulsion.voltage_nominal_V * one
        still = np.zeros((self.rig.n_rotors, 1))
        return float(
            self._thrust_N(still, parked, nominal_V, elapsed_s * one, self.time_s * one)[0]
        )

    def _counts(self, force_N: Array, white: Array) -> Array:
        """Return the amplifier's counts (m,); whole ones unless the quantum is absent."""
        counts = self._readers["thrust"].read(force_N, white) / self.count_N
        if self._flaws.thrust_quantum_N:
            counts = np.round(counts)
        clipped: Array = np.clip(counts, -COUNT_TOP, COUNT_TOP - 1)
        return clipped

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

    def _rate_of(self, family: str) -> float:
        sensor = self.rig.sensors.get(family)
        return sensor.rate_Hz if sensor else 0.0

    def _plain(self, family: str) -> Reader:
        sensor = self.rig.sensors.get(family)
        return Reader(sensor.noise, sensor.quantum, sensor.rate_Hz) if sensor else Reader()


def _speed_change(truth: Model) -> SpeedChange | None:
    """Return how the model's own effects change the speed that a pulse gives."""
    acting = [effect for effect in truth.present_effects if effect.speed is not None]
    if not acting:
        return None
    values = truth.parameters.values_array()

    def changed(speed_rad_s: Array, voltage_V: float, time_s: float) -> Array:
        speeds = speed_rad_s.copy()
        flow = Flow(**_NOTHING | {"voltage_V": voltage_V, "time_s": time_s})
        for effect in acting:
            p = truth.effect_values(effect, values)
            for i, speed in enumerate(speeds):
                speeds[i] = effect.speed(i, speed, flow, p) if effect.speed else speed
        return speeds

    return changed


_NOTHING = dict.fromkeys(Flow._fields, 0.0)


def _lag_s(truth: Model, flaws: Imperfections) -> float:
    """Return the whole motor lag: the model's own where it states one."""
    if "motor_lag.tau_s" in truth.parameters:
        return truth.parameters["motor_lag.tau_s"].value
    return flaws.motor_lag_s
