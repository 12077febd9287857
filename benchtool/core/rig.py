"""Rig: vehicle or rotor on the bench, sensors, plate and limits, with sources."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Le, Len
from numpy.typing import NDArray

from benchtool.core.choices import PlateMover, Surface
from benchtool.core.text import pluralize
from benchtool.core.toml_text import FiniteTable
from benchtool.core.units import Array

Positive = Annotated[float, Gt(0.0)]
NotNegative = Annotated[float, Ge(0.0)]


@dataclass(frozen=True, slots=True, kw_only=True)
class RotorPosition(FiniteTable):
    """Position of one rotor; rotors at the same position are coaxial and share one disc.

    Attributes:
        name: display name, such as front left.
        x_m: forward of the centre.
        y_m: left of the centre.
        spin: 1 counter-clockwise, seen from above; -1 clockwise.
    """

    name: str
    x_m: float
    y_m: float
    spin: Literal[-1, 1]


@dataclass(frozen=True, slots=True, kw_only=True)
class Propulsion(FiniteTable):
    """Motor, ESC and rotor, the same at every position.

    Attributes:
        radius_m: rotor radius.
        thrust_coefficient_N_s2: k of T = k w^2 (eq. 8), N/(rad/s)^2.
        drag_coefficient_Nm_s2: c of Q = c w^2 (eq. 8), N m/(rad/s)^2.
        pwm_stop_us: pulse at which the motor is at standstill.
        pwm_start_us: pulse at which the linear speed curve is zero.
        pwm_max_us: maximum pulse.
        speed_per_us_rad_s: slope of speed over pulse at nominal voltage.
        voltage_nominal_V: battery voltage of that slope.
        lag_s: first-order time constant of speed.
        efficiency: mechanical over electrical power at hover, for current and power readings.
    """

    radius_m: Positive
    thrust_coefficient_N_s2: Positive
    drag_coefficient_Nm_s2: Positive
    pwm_stop_us: Positive
    pwm_start_us: Positive
    pwm_max_us: Positive
    speed_per_us_rad_s: Positive
    voltage_nominal_V: Positive
    lag_s: NotNegative
    efficiency: Annotated[float, Gt(0.0), Le(1.0)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Propeller(FiniteTable):
    """Geometry of a propeller.

    Attributes:
        diameter_m: of the disc.
        pitch_m: advance per revolution, from its name.
        blades: number of blades.
        chord_m: chord of a blade at `CHORD_RADIUS` of the radius.
        diameter_sd, chord_sd: relative standard uncertainties.
    """

    name: str
    title: str = ""
    diameter_m: Positive
    pitch_m: Positive | None = None
    blades: Annotated[int, Ge(1), Le(20)] | None = None
    chord_m: Positive | None = None
    diameter_sd: NotNegative = 0.0
    chord_sd: NotNegative = 0.0


CHORD_RADIUS = 0.75  # radius fraction of the blade's Reynolds number, by convention


@dataclass(frozen=True, slots=True, kw_only=True)
class Blade(FiniteTable):
    """Blades of a rotor, for the response of thrust and torque to a change of inflow.

    Attributes:
        solidity: blade area over disc area.
        lift_slope: of the blade's section: 1/rad.
        pitch_rad: angle of the untwisted blade, or at three quarters of the radius.
        profile_drag: mean drag coefficient of the section.
    """

    solidity: Positive
    lift_slope: Positive
    pitch_rad: Positive
    profile_drag: NotNegative


@dataclass(frozen=True, slots=True, kw_only=True)
class Motor(FiniteTable):
    """Motor data, for the change of speed with torque at a fixed pulse.

    Attributes:
        governed: whether the ESC controls the speed; the other values are then used for power only.
        Kv_rpm_V: speed over voltage without load: rpm/V.
        resistance_ohm: of windings, leads and ESC.
        no_load_current_A: current without rotor.
    """

    governed: bool = False
    Kv_rpm_V: Positive | None = None
    resistance_ohm: Positive | None = None
    no_load_current_A: NotNegative = 0.0

    @property
    def has_curve(self) -> bool:
        """True if the torque at a voltage and speed is known."""
        return self.Kv_rpm_V is not None and self.resistance_ohm is not None


@dataclass(frozen=True, slots=True, kw_only=True)
class Body(FiniteTable):
    """Mass and inertia of the whole vehicle about its centre.

    Attributes:
        mass_kg: of the whole vehicle.
        inertia_xx_kgm2: about the x axis, roll.
        inertia_yy_kgm2: about the y axis, pitch.
        inertia_zz_kgm2: about the z axis, yaw.
        half_diagonal_m: b of eq. (4) for a body that is not a cross of rotor arms (a beam with two
            rotors); it is then treated as a quadrotor body with that half diagonal.
        arm_sd: relative standard uncertainty of the rotor positions, common to all.
    """

    mass_kg: Positive
    inertia_xx_kgm2: Positive
    inertia_yy_kgm2: Positive
    inertia_zz_kgm2: Positive
    half_diagonal_m: Positive | None = None
    arm_sd: NotNegative = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensor(FiniteTable):
    """Sensor data, in the channel's unit.

    Attributes:
        rate_Hz: new readings per second.
        quantum: resolution of readings.
        noise: white noise of one reading (sd).
        flicker: 1/f noise of the zero: sd over one decade of frequency.
        walk: random walk of the zero: sd after one second.
        scale_sd: relative standard uncertainty of the scale; replaced by a calibration.
        zero_sd: standard deviation of the zero after a tare; without it a sweep accepts an offset
            below 0.1 % of the thrust limit.
        valid_days: age at which a calibration is reported as expired; assumed: the usual interval
            for load cells and masses.
    """

    noise: NotNegative = 0.0
    quantum: NotNegative = 0.0
    rate_Hz: Positive = 80.0
    valid_days: Positive = 365.0
    flicker: NotNegative = 0.0
    walk: NotNegative = 0.0
    scale_sd: NotNegative = 0.0
    zero_sd: NotNegative = 0.0

    def mean_error(self, n: Array) -> Array:
        """Return the standard error of a mean over n readings (...,)."""
        common = rounding_error(self.noise, self.quantum)
        independent2 = self.noise**2 + self.quantum**2 / 12.0 - common**2
        return np.asarray(np.sqrt(independent2 / n + common**2), float)


def rounding_error(noise: float, quantum: float) -> float:
    """Return the rounding error common to all readings, which averaging does not reduce.

    quantum/sqrt(12) without noise; noise reduces it by the characteristic function of the noise at
    one over the quantum (Widrow and Kollar, Quantization Noise, 2008, ch. 19): 0.7 % at half a
    quantum.
    """
    if not quantum:
        return 0.0
    return float(quantum / 12.0**0.5 * np.exp(-2.0 * (np.pi * noise / quantum) ** 2))


@dataclass(frozen=True, slots=True, kw_only=True)
class PlateDrive(FiniteTable):
    """Plate and its stage.

    Attributes:
        surface: position of the plate: "below" the rotors (in the wake), "above", or "beside".
        moved_by: "device" (the bench itself), "grbl" (a G-code stage) or "hand".
        z_min_m, z_max_m: travel; the plate never comes closer than z_min_m.
        x_max_m: lateral travel to either side; default: `Rig.plate_x_max_m`.
        z_park_m: distance out of ground effect.
        speed_m_s: feed rate.
        backlash_m: play at a change of direction; distances are valid for an approach from farther.
        repeatability_m: sd of repeated positioning from either side; without it the backlash is
            used for positions approached from both sides.
        size_x_m, size_y_m: plate dimensions.
    """

    moved_by: PlateMover
    z_min_m: Positive
    z_max_m: Positive
    z_park_m: Positive
    speed_m_s: Positive
    backlash_m: NotNegative
    size_x_m: Positive
    size_y_m: Positive
    x_max_m: NotNegative | None = None
    surface: Surface = "below"
    repeatability_m: NotNegative | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits(FiniteTable):
    """Limits of readings and commands.

    Attributes:
        thrust_N: of either sign; never above the load cell's rating.
        load_cell_rating_N: from the data sheet.
        rpm: of each rotor.
        current_A: of the supply.
        voltage_min_V: the battery is empty below it.
        temperature_degC: of every temperature channel.
        pwm_us: longest pulse ever sent.
    """

    thrust_N: Positive
    load_cell_rating_N: Positive
    rpm: Positive
    current_A: Positive
    voltage_min_V: NotNegative
    temperature_degC: Positive
    pwm_us: Positive


UNSPECIFIED = "not stated, typical"  # prefix of the source of a value missing in a rig file


@dataclass(frozen=True, kw_only=True)
class Rig(FiniteTable):
    """Description of a bench for models and devices.

    Attributes
    ----------
    rotors : tuple of RotorPosition
        In the order of channels pwm1, rpm1 and so on.
    blade, motor : Blade, Motor
        None if unknown; without blade eq. (10) is used as printed.
    propeller : Propeller
        Geometry of the rotors, with the diameter of `propulsion`; None if unknown.
    sensors : mapping of Sensor
        By channel family: "thrust_N", "rpm", "voltage_V", "current_A", "plate_z_m".
    sources : mapping of str
        Source of each number, by dotted key.
    assumed : tuple of str
        Dotted keys of assumed values.
    """

    name: str
    title: str
    rotors: Annotated[tuple[RotorPosition, ...], Len(1, 16)]
    propulsion: Propulsion
    body: Body
    sensors: Mapping[str, Sensor]
    plate: PlateDrive
    limits: Limits
    blade: Blade | None = None
    motor: Motor | None = None
    propeller: Propeller | None = None
    sources: Mapping[str, str] = field(default_factory=dict)
    assumed: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return (
            f"Rig {self.name}: {self.title}\n"
            f"  {pluralize(self.n_rotors, 'rotor')} of radius {self.propulsion.radius_m:g} m, "
            f"mass {self.body.mass_kg:g} kg, thrust at most {self.limits.thrust_N:g} N\n"
            f"  {len(self.assumed)} of {len(self.sources)} numbers assumed"
        )

    @cached_property
    def not_stated(self) -> frozenset[str]:
        """Dotted keys missing in the rig file, replaced by typical values."""
        return frozenset(
            key for key, source in self.sources.items() if source.startswith(UNSPECIFIED)
        )

    @property
    def n_rotors(self) -> int:
        """Number of rotors."""
        return len(self.rotors)

    @property
    def plate_x_max_m(self) -> float:
        """Lateral travel of the plate to either side; default: until it clears every rotor."""
        if self.plate.x_max_m is not None:
            return self.plate.x_max_m
        reach_m = max(abs(rotor.x_m) for rotor in self.rotors) + self.propulsion.radius_m
        return 0.5 * self.plate.size_x_m + reach_m

    def position_sd_m(self, *, one_sided: bool = False) -> float:
        """Return the standard deviation of a plate position: m.

        Args:
            one_sided: whether positions were approached from one side (constant backlash).
        """
        noise_m = self.sensors["plate_z_m"].noise if "plate_z_m" in self.sensors else 0.0
        position_sd_m = self.plate.repeatability_m
        if position_sd_m is None:
            position_sd_m = 0.0 if one_sided else self.plate.backlash_m / 12.0**0.5
        return float(np.hypot(position_sd_m, noise_m))

    @cached_property
    def disc_of_rotor(self) -> NDArray[np.intp]:
        """Disc index of each rotor (n_rotors,): coaxial rotors share one disc."""
        positions = [(round(rotor.x_m, 6), round(rotor.y_m, 6)) for rotor in self.rotors]
        unique = list(dict.fromkeys(positions))
        return np.array([unique.index(position) for position in positions], np.intp)

    @cached_property
    def rotors_on_disc(self) -> tuple[int, ...]:
        """Number of rotors of each disc (n_discs,)."""
        return tuple(np.bincount(self.disc_of_rotor).tolist())

    @cached_property
    def first_rotors(self) -> tuple[int, ...]:
        """First rotor (from 0) of each disc, whose columns represent it (n_discs,)."""
        return tuple(int(np.argmax(self.disc_of_rotor == disc)) for disc in range(self.n_discs))

    @cached_property
    def n_discs(self) -> int:
        """Number of discs; coaxial rotors share one."""
        return int(self.disc_of_rotor.max()) + 1

    @cached_property
    def disc_positions_m(self) -> Array:
        """Disc centres (n_discs, 2): x, y in m."""
        return np.array(
            [[self.rotors[i].x_m, self.rotors[i].y_m] for i in self.first_rotors], float
        )

    @cached_property
    def disc_distances_m(self) -> Array:
        """Distances between disc axes (n_discs, n_discs): m."""
        difference = self.disc_positions_m[:, None, :] - self.disc_positions_m[None, :, :]
        distances: Array = np.hypot(difference[..., 0], difference[..., 1])
        return distances
