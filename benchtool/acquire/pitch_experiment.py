"""Pitch experiment and its check against the limits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import degrees, isfinite, pi, radians, sqrt

from benchtool.acquire.check_plan import PlanExtremes
from benchtool.bench.bench import DeviceInfo
from benchtool.core.errors import InputError, PlanError
from benchtool.core.rig import Rig

GRAVITY_M_S2 = 9.81  # as in the simulated pitch bench
MAX_DURATION_S = 3600.0  # longer ones are probably typing errors; assumed
PITCH_LIMIT_RAD = radians(45.0)  # default host limit, equal to the device's; assumed
RATE_LIMIT_RAD_S = 10.0  # host limit, equal to the device's; assumed
REQUIRED_CHANNELS = ("theta_rad", "gyro_rad_s")  # of every pitch bench


@dataclass(frozen=True, slots=True, kw_only=True)
class PitchExperiment:
    """Pitch experiment.

    Attributes:
        seconds: time at full collective, bench time.
        collective_us: pulse of every motor that arms the device; the control loop adds to it.
        plate_z_m: initial plate distance; None: unchanged.
        schedule: name for the record; default: name reported by the device.
    """

    seconds: float
    collective_us: float
    plate_z_m: float | None = None
    pitch_limit_rad: float = PITCH_LIMIT_RAD
    schedule: str = ""

    def to_toml(self) -> str:
        """Return the text of plan.toml."""
        lines = [
            "[record]",
            f"seconds = {self.seconds!r}",
            f"collective_us = {self.collective_us!r}",
            f"pitch_limit_deg = {degrees(self.pitch_limit_rad)!r}",
        ]
        if self.plate_z_m is not None:
            lines.append(f"plate_z_m = {self.plate_z_m!r}")
        if self.schedule:
            lines.append("schedule = '" + self.schedule.replace("'", "") + "'")
        return "\n".join(lines) + "\n"


def hover_pulse_us(rig: Rig) -> float:
    """Return the hover pulse out of ground effect, rounded: us."""
    p = rig.propulsion
    thrust_N = rig.body.mass_kg * GRAVITY_M_S2 / rig.n_rotors
    speed_rad_s = sqrt(thrust_N / p.thrust_coefficient_N_s2)
    return float(round(p.pwm_start_us + speed_rad_s / p.speed_per_us_rad_s))


def check_experiment(
    experiment: PitchExperiment,
    rig: Rig,
    device_limits: Mapping[str, float] | None = None,
    idle_us: float | None = None,
) -> PlanExtremes:
    """Return the maxima at the collective; raise PlanError if they exceed the limits.

    Args:
        idle_us: pulse above which the device arms; default: start pulse of the rig.
    """
    seconds, pulse_us = experiment.seconds, experiment.collective_us
    if not (isfinite(seconds) and 0.0 < seconds <= MAX_DURATION_S):
        raise PlanError(f"--seconds is {seconds:g}; give more than 0, at most {MAX_DURATION_S:g}")
    if not 0.0 < experiment.pitch_limit_rad <= 0.5 * pi:
        limit_deg = degrees(experiment.pitch_limit_rad)
        raise PlanError(f"--limit-deg is {limit_deg:g}; give more than 0, at most 90")
    device = dict(device_limits or {})
    p, limits = rig.propulsion, rig.limits
    min_us = max(p.pwm_start_us, idle_us or 0.0)
    max_us = min(limits.pwm_us, p.pwm_max_us, device.get("pwm_us", p.pwm_max_us))
    if not min_us < pulse_us <= max_us:
        raise PlanError(
            f"collective {pulse_us:g} us is out of range; allowed: above {min_us:g} us, at most "
            f"{max_us:g} us"
        )
    speed_rad_s = p.speed_per_us_rad_s * (pulse_us - p.pwm_start_us)
    rpm = speed_rad_s * 30.0 / pi
    max_rpm = min(limits.rpm, device.get("rpm", limits.rpm))
    if rpm > max_rpm:
        raise PlanError(
            f"collective {pulse_us:g} us gives about {rpm:.0f} rpm, limit {max_rpm:.0f} rpm; "
            f"lower --collective"
        )
    thrust_N = rig.n_rotors * p.thrust_coefficient_N_s2 * speed_rad_s**2
    if thrust_N > limits.thrust_N:
        raise PlanError(
            f"collective {pulse_us:g} us gives about {thrust_N:.1f} N, limit "
            f"{limits.thrust_N:g} N; lower --collective"
        )
    low_m, high_m = rig.plate.z_min_m, rig.plate.z_max_m
    if experiment.plate_z_m is not None and not low_m <= experiment.plate_z_m <= high_m:
        raise PlanError(
            f"--plate-z-m is {experiment.plate_z_m:g}; allowed: {low_m:g} to {high_m:g} m of rig "
            f"{rig.name!r}"
        )
    return PlanExtremes(pulse_us, rpm, thrust_N, thrust_N)


def expected_extremes(identity: DeviceInfo, experiment: PitchExperiment, rig: Rig) -> PlanExtremes:
    """Return the result of `check_experiment` with the limits of an open bench.

    Raises:
        InputError: not a pitch bench.
        PlanError: limits of bench or rig are exceeded.
    """
    require_pitch(identity)
    return check_experiment(experiment, rig, identity.limits, identity.pwm_idle_us)


def require_pitch(identity: DeviceInfo) -> None:
    """Raise InputError for a bench without pitch channels."""
    names = {channel.name for channel in identity.channels}
    missing = [name for name in REQUIRED_CHANNELS if name not in names]
    if missing:
        raise InputError(
            f"{identity.address} is not a pitch bench: channel {missing[0]} is missing; use a "
            f"pitch bench (virtual: sim:RIG?mode=pitch, or benchtool bench serve --mode pitch)"
        )


def arming_text(experiment: PitchExperiment, rig: Rig, expected: PlanExtremes) -> str:
    """Return the prompt shown before arming."""
    names = [f"{number + 1} ({rotor.name})" for number, rotor in enumerate(rig.rotors)]
    return (
        f"rotors that will turn: {', '.join(names)}; the beam is free to turn\n"
        f"collective: {experiment.collective_us:g} us of {rig.limits.pwm_us:g} us, about "
        f"{expected.rpm:.0f} rpm and {expected.thrust_N:.1f} N in total; the control loop adds "
        f"to it\n"
        f"stops beyond {degrees(experiment.pitch_limit_rad):g} deg; records "
        f"{experiment.seconds:g} s"
    )
