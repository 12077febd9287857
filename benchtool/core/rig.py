"""A rig: the vehicle or rotor on the bench, its sensors, its plate and its limits, with sources."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Le, Len
from numpy.typing import NDArray

from benchtool.core.array_type import Array
from benchtool.core.toml_text import FiniteTable

Surface = Literal["below", "above", "beside"]  # in the wake, at the intake, or to the side

Positive = Annotated[float, Gt(0.0)]
NotNegative = Annotated[float, Ge(0.0)]


@dataclass(frozen=True, slots=True, kw_only=True)
class RotorPosition(FiniteTable):
    """Place one rotor; rotors at one place are coaxial and count as one disc.

    Attributes:
        name: for people, such as front left.
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
    """Describe motor, ESC and rotor, the same for every place.

    Attributes:
        radius_m: rotor radius.
        thrust_coefficient_N_s2: k of T = k w^2 (eq. 8), N/(rad/s)^2.
        drag_coefficient_Nm_s2: c of Q = c w^2 (eq. 8), N m/(rad/s)^2.
        pwm_stop_us: pulse at which the motor stands still.
        pwm_start_us: pulse at which the speed line crosses zero.
        pwm_max_us: longest pulse.
        speed_per_us_rad_s: slope of speed over pulse at nominal voltage.
        voltage_nominal_V: battery voltage at which the slope holds.
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
    """Describe the geometry of a propeller.

    Attributes:
        diameter_m: of the disc.
        pitch_m: advance of a turn, as its name gives it.
        blades: how many there are.
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


CHORD_RADIUS = 0.75  # share of the radius of a blade's Reynolds number, as usual


@dataclass(frozen=True, slots=True, kw_only=True)
class Blade(FiniteTable):
    """Describe a rotor's blades: they decide how thrust and torque answer to a slower inflow.

    Attributes:
        solidity: blade area over disc area.
        lift_slope: of the blade's section: 1/rad.
        pitch_rad: angle of the blade, untwisted, or that at three quarters of the radius.
        profile_drag: mean drag coefficient of the section.
    """

    solidity: Positive
    lift_slope: Positive
    pitch_rad: Positive
    profile_drag: NotNegative


@dataclass(frozen=True, slots=True, kw_only=True)
class Motor(FiniteTable):
    """Describe what the speed at a fixed pulse does when the rotor's torque changes.

    Attributes:
        governed: whether the ESC holds the speed; the other numbers then serve for power alone.
        Kv_rpm_V: speed over voltage without load: rpm/V.
        resistance_ohm: of windings, leads and ESC.
        no_load_current_A: current that turns no rotor.
    """

    governed: bool = False
    Kv_rpm_V: Positive | None = None
    resistance_ohm: Positive | None = None
    no_load_current_A: NotNegative = 0.0

    @property
    def has_curve(self) -> bool:
        """Whether its torque at a voltage and speed is known."""
        return self.Kv_rpm_V is not None and self.resistance_ohm is not None


@dataclass(frozen=True, slots=True, kw_only=True)
class Body(FiniteTable):
    """Describe mass and inertia of the whole vehicle about its centre.

    Attributes:
        mass_kg: of the whole vehicle.
        inertia_xx_kgm2: about the x axis, roll.
        inertia_yy_kgm2: about the y axis, pitch.
        inertia_zz_kgm2: about the z axis, yaw.
        half_diagonal_m: b of eq. (4) where the body is no cross of the rotors' own arms (a beam
            with two rotors); the body then counts as a quadrotor's with that half diagonal.
        arm_sd: relative standard uncertainty of the rotors' places, common to all.
    """

    mass_kg: Positive
    inertia_xx_kgm2: Positive
    inertia_yy_kgm2: Positive
    inertia_zz_kgm2: Positive
    half_diagonal_m: Positive | None = None
    arm_sd: NotNegative = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensor(FiniteTable):
    """Describe one sensor, in the channel's unit.

    Attributes:
        rate_Hz: new readings per second.
        quantum: step between readings.
        noise: white noise of one reading (sd).
        flicker: 1/f noise of its zero: sd over one decade of frequency.
        walk: random walk of its zero: sd after one second.
        scale_sd: relative standard uncertainty of its scale; a calibration takes its place.
        zero_sd: standard deviation of its zero after a tare; without it a sweep takes any rest
            below 0.1 % of the thrust limit.
        valid_days: age from which its calibration is reported as too old. A choice: the usual
            interval of load cells and masses.
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
        alike = rounding_error(self.noise, self.quantum)
        apart2 = self.noise**2 + self.quantum**2 / 12.0 - alike**2
        return np.asarray(np.sqrt(apart2 / n + alike**2), float)


def rounding_error(noise: float, quantum: float) -> float:
    """Return the error of rounding that readings of such noise share, so that no mean takes it out.

    quantum/sqrt(12) without noise; noise carries readings over steps and leaves of it the
    characteristic function of the noise at one over the quantum (Widrow and Kollar, Quantization
    Noise, 2008, ch. 19): 0.7 % at half a quantum.
    """
    if not quantum:
        return 0.0
    return float(quantum / 12.0**0.5 * np.exp(-2.0 * (np.pi * noise / quantum) ** 2))


@dataclass(frozen=True, slots=True, kw_only=True)
class PlateDrive(FiniteTable):
    """Describe the plate, and what moves it.

    Attributes:
        surface: where it stands: "below" the rotors, in their wake, "above" them, or "beside".
        moved_by: "device" (the bench itself), "grbl" (a G-code stage) or "hand".
        z_min_m, z_max_m: travel; the plate never comes nearer than z_min_m.
        x_max_m: lateral travel to either side; `Rig.plate_x_max_m` stands in when left out.
        z_park_m: distance at which the plate counts as out of ground effect.
        speed_m_s: feed.
        backlash_m: play when the direction changes; distances hold after an approach from farther.
        repeatability_m: sd with which a place is found again, however it is approached; without
            it the play counts where places are approached from both sides.
        size_x_m, size_y_m: plate dimensions.
    """

    moved_by: Literal["device", "grbl", "hand"]
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
    """State what no reading may exceed.

    Attributes:
        thrust_N: of either sign; never above the load cell's rating.
        load_cell_rating_N: by its data sheet.
        rpm: of each rotor.
        current_A: of the supply.
        voltage_min_V: below it the pack is empty.
        temperature_degC: of whatever the bench measures.
        pwm_us: longest pulse that is ever sent.
    """

    thrust_N: Positive
    load_cell_rating_N: Positive
    rpm: Positive
    current_A: Positive
    voltage_min_V: NotNegative
    temperature_degC: Positive
    pwm_us: Positive


UNSPECIFIED = (
    "not stated, typical"  # how the source begins of a number that a rig's file leaves out
)


@dataclass(frozen=True, kw_only=True)
class Rig(FiniteTable):
    """Describe everything about a bench that a model or a device needs.

    Attributes:
        rotors: places, in the order of channels pwm1, rpm1 and so on.
        blade: None where nobody knows it; eq. (10) then holds as printed.
        motor: None where nobody knows it.
        propeller: geometry of the rotors, of the diameter that `propulsion` states; None where
            nobody knows more than that.
        sensors: by channel family: "thrust_N", "rpm", "voltage_V", "current_A", "plate_z_m".
        sources: where each number comes from, by its dotted key.
        assumed: dotted keys whose numbers are assumptions, not measurements.
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

    @cached_property
    def not_stated(self) -> frozenset[str]:
        """Dotted keys that the rig's file leaves out, for which typical numbers stand in."""
        return frozenset(key for key, why in self.sources.items() if why.startswith(UNSPECIFIED))

    @property
    def n_rotors(self) -> int:
        """How many rotors there are."""
        return len(self.rotors)

    @property
    def plate_x_max_m(self) -> float:
        """Lateral travel of the plate to either side; if not stated, until it leaves each rotor."""
        if self.plate.x_max_m is not None:
            return self.plate.x_max_m
        reach_m = max(abs(place.x_m) for place in self.rotors) + self.propulsion.radius_m
        return 0.5 * self.plate.size_x_m + reach_m

    def place_sd_m(self, *, one_sided: bool = False) -> float:
        """Return how far the plate may stand from where it is read at a stay, one sd.

        Args:
            one_sided: whether places were approached from one side: their play is then no scatter.
        """
        noise_m = self.sensors["plate_z_m"].noise if "plate_z_m" in self.sensors else 0.0
        found_m = self.plate.repeatability_m
        if found_m is None:
            found_m = 0.0 if one_sided else self.plate.backlash_m / 12.0**0.5
        return float(np.hypot(found_m, noise_m))

    @cached_property
    def disc_of_rotor(self) -> NDArray[np.intp]:
        """Disc that each rotor belongs to (n_rotors,): coaxial rotors share one disc."""
        places = [(round(place.x_m, 6), round(place.y_m, 6)) for place in self.rotors]
        first = list(dict.fromkeys(places))
        return np.array([first.index(place) for place in places], np.intp)

    @cached_property
    def rotors_on_disc(self) -> tuple[int, ...]:
        """How many rotors blow through each disc (n_discs,)."""
        return tuple(np.bincount(self.disc_of_rotor).tolist())

    @cached_property
    def first_rotors(self) -> tuple[int, ...]:
        """First rotor (from 0) of each disc, whose columns stand for it (n_discs,)."""
        return tuple(int(np.argmax(self.disc_of_rotor == disc)) for disc in range(self.n_discs))

    @cached_property
    def n_discs(self) -> int:
        """How many discs there are: coaxial rotors blow through one."""
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
