"""Measured point of a visit from its samples: checks while they arrive, and robust means."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf, nan, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from benchtool.acquire.average import Average, average, estimate_quantum, is_settled
from benchtool.acquire.motors import TareResult
from benchtool.acquire.plan import SettlePart
from benchtool.acquire.record import Samples
from benchtool.acquire.visit_order import Visit
from benchtool.bench.bench import Readings
from benchtool.bench.limit_check import CHECKS, ChannelChecks
from benchtool.core.channel import channel_family
from benchtool.core.recording import Recording
from benchtool.core.rig import Sensor
from benchtool.core.units import Array
from benchtool.data.run.points import Point, averaged_channels

FROZEN_S, FROZEN_VALUES = 1.0, 20  # minimum duration and count of a repeated value; assumed
FALSE_ALARM_PROBABILITY = 1e-9  # of a repetition by noise; assumed
MIN_RELATIVE_CHANGE = 0.05  # of thrust per squared speed within a visit; above drift; assumed
MAX_LAG_S = 1.0  # of a load cell after a pulse change: twice that of slow ones; assumed
MAX_DELAY_PERIODS = 3.0  # maximum age of a value in periods of its channel; assumed


def required_samples(name: str) -> bool:
    """Return True for a channel that a point requires."""
    return CHECKS.get(channel_family(name), ChannelChecks()).is_required


@dataclass(frozen=True, slots=True, kw_only=True)
class VisitChecks:
    """Checks of the samples of one visit, during and after sampling.

    Attributes:
        rates_Hz: expected rate of each channel that is checked.
        sensors: of the rig, by channel family.
        seconds, share: sampling time, and required fraction of the samples.
        before: last value of each channel in the previous visit at other pulses; empty if the
            pulses are the same or zero was commanded in between.
    """

    rates_Hz: Mapping[str, float]
    sensors: Mapping[str, Sensor]
    seconds: float
    share: float
    before: Mapping[str, float] = field(default_factory=dict)

    def shortage(self, samples: Recording) -> str:
        """Return a message for a required channel with too few samples, or ""."""
        for name in filter(required_samples, self.rates_Hz):
            expected = self.seconds * self.rates_Hz[name]
            count = int(np.isfinite(samples.column(name)).sum())
            # The sampling time may start just after a value.
            if count < self.share * expected - 1.0 or not count:
                return (
                    f"{count} of {expected:.0f} samples of {name} received, minimum "
                    f"{100.0 * self.share:g} % (sample_share)"
                )
        return ""

    def late(self, samples: Recording) -> str:
        """Return a message for a required channel whose newest value is too old, or "".

        Too old means older than three periods of its channel and than the gap that `share` allows,
        while other channels have values.
        """
        time_s = samples.column("time_s")
        for name in filter(required_samples, self.rates_Hz if len(time_s) else ()):
            if not (rate_Hz := self.rates_Hz[name]):
                continue
            present = np.isfinite(samples.column(name))
            newest_s = time_s[present][-1] if present.any() else time_s[0]
            allowed_s = max(MAX_DELAY_PERIODS / rate_Hz, (1.0 - self.share) * self.seconds)
            if (age_s := float(time_s[-1] - newest_s)) > allowed_s:
                return (
                    f"the newest value of {name} is {age_s:.2f} s old, its period is "
                    f"{1.0 / rate_Hz:.3g} s, limit {allowed_s:.2f} s; check its sensor and wiring"
                )
        return ""

    def frozen(self, samples: Recording, commanded_s: float) -> dict[str, str]:
        """Return a message for each frozen channel.

        Args:
            samples: of the visit, from the end of its ramp.
        """
        messages = {}
        for name in self.rates_Hz:
            column, time_s = samples.column(name), samples.column("time_s")
            present = np.isfinite(column)
            values, times_s = column[present], time_s[present]
            if not len(values):
                continue
            others = np.flatnonzero(values != values[-1])
            first = int(others[-1]) + 1 if len(others) else 0
            count, since_s = len(values) - first, float(times_s[first])
            if count < FROZEN_VALUES or times_s[-1] - since_s < FROZEN_S:
                continue
            if reason := self._frozen_reason(name, float(values[-1]), count) or self._changed(
                name, samples, max(since_s, commanded_s + MAX_LAG_S)
            ):
                messages[name] = (
                    f"{name} repeats {values[-1]:.6g} for {times_s[-1] - since_s:.1f} s "
                    f"({count} values), {reason}"
                )
        return messages

    def _frozen_reason(self, name: str, number: float, count: int) -> str:
        checks = CHECKS.get(channel_family(name), ChannelChecks())
        sensor = self.sensors.get(channel_family(name), Sensor())
        if sensor.noise > 0.0:
            # Probability of equal readings: quantum times the density of their difference at zero.
            equal = sensor.quantum / (2.0 * sqrt(pi) * sensor.noise)
            if min(equal, 1.0) ** (count - 1) < FALSE_ALARM_PROBABILITY:
                return (
                    f"but noise {sensor.noise:g} at resolution {sensor.quantum:g} is expected; "
                    f"check its sensor, or correct sensors.{channel_family(name)} of the rig"
                )
        if checks.follows_pulse_width and number == self.before.get(name):
            return "the same as at the previous pulses; check its sensor and wiring"
        return ""

    def _changed(self, name: str, samples: Recording, since_s: float) -> str:
        """Return a message if thrust over squared speed changed while a channel was constant."""
        rotors = [other for other in self.rates_Hz if channel_family(other) == "rpm"]
        time_s = samples.column("time_s")
        if not rotors or name not in ("thrust_N", *rotors) or time_s[-1] - since_s < FROZEN_S:
            return ""
        thirds = np.linspace(since_s, time_s[-1], 4)
        ratios = []
        for low_s, high_s in ((thirds[0], thirds[1]), (thirds[2], thirds[3])):
            rows = (time_s >= low_s) & (time_s <= high_s)
            thrust, *speeds = (
                _mean(samples.column(other)[rows]) for other in ("thrust_N", *rotors)
            )
            squares = sum(speed**2 for speed in speeds)
            ratios.append(thrust / squares if squares > 0.0 else nan)
        change = abs(ratios[1] / ratios[0] - 1.0) if ratios[0] else nan
        if not change > MIN_RELATIVE_CHANGE:
            return ""
        return (
            f"while thrust over the squared speeds changed by {100.0 * change:.0f} %; check its "
            f"sensor and wiring"
        )


def _mean(values: Array) -> float:
    present = values[np.isfinite(values)]
    return float(present.mean()) if len(present) else nan


CHECK_INTERVAL_S, CHECK_SPAN_S = 0.25, 30.0  # interval and span of checks; assumed


class VisitWatch:
    """Samples of an attempt at a visit, with checks while they arrive.

    Attributes:
        problem: event and text of the first problem that spoils the visit.
        remarks: problems of channels that a point does not require, by channel.
    """

    def __init__(self, checks: VisitChecks, samples: Samples, commanded_s: float) -> None:
        self.samples = samples
        self._checks, self._commanded_s = checks, commanded_s
        self._first_row, self._checked_s = 0, -inf
        self.problem: tuple[str, str] | None = None
        self.remarks: dict[str, str] = {}

    def update(self, readings: Readings) -> bool:
        """Add readings; return True if the visit has a problem."""
        if not len(readings):
            return False
        self.samples.append(readings)
        time_s = self.samples.recording().column("time_s")
        now_s = float(time_s[-1])
        if now_s - self._checked_s < CHECK_INTERVAL_S:
            return False
        self._checked_s = now_s
        while time_s[self._first_row] < now_s - CHECK_SPAN_S:
            self._first_row += 1
        recent = self.samples.recording(self._first_row)
        if late := self._checks.late(recent):
            self.problem = ("late", late)
        for name, text in self._checks.frozen(recent, self._commanded_s).items():
            if required_samples(name):
                self.problem = ("frozen", text)
            else:
                self.remarks.setdefault(name, text)
        return self.problem is not None


def has_settled(samples: Recording, driven: NDArray[np.intp], plan: SettlePart) -> bool:
    """Return True if thrust and the speeds of driven rotors (from 0) have settled."""
    names = ["thrust_N", *(f"rpm{rotor + 1}" for rotor in driven)]
    channels = [samples.column(name) for name in names if name in samples]
    return is_settled(samples.column("time_s"), channels, plan.window_s, plan.slope_per_s)


MIN_BEAT_CYCLES = 1.0  # of a vibration within a point, to separate it from thrust; assumed


def is_aliased(rpm: float, time_s: Array) -> str:
    """Return a warning if a rotor's vibration is aliased to zero frequency, else "".

    A vibration at a multiple of the sampling rate is the same in every sample: it is not visible in
    the scatter and changes the mean by up to its amplitude.
    """
    span_s = float(time_s[-1] - time_s[0]) if len(time_s) > 1 else 0.0
    if not (span_s > 0.0 and rpm > 0.0):
        return ""
    rate_Hz, rotor_Hz = (len(time_s) - 1) / span_s, rpm / 60.0
    multiple = round(rotor_Hz / rate_Hz)
    if not multiple or abs(rotor_Hz - multiple * rate_Hz) * span_s >= MIN_BEAT_CYCLES:
        return ""
    times = "" if multiple == 1 else f"{multiple} times "
    return (
        f"turned at {rotor_Hz:.1f} Hz, {times}the load cell's sampling rate of {rate_Hz:.1f} Hz: "
        f"its vibration is aliased to a thrust offset; use a slightly different pulse"
    )


def measure(
    samples: Recording,
    visit: Visit,
    plate_stage_z_m: float,
    tare: TareResult,
    sensors: Mapping[str, Sensor],
    settled: bool,
) -> tuple[Point, list[tuple[str, str]]]:
    """Return the point of a visit's samples, and its events by kind and text.

    Args:
        plate_stage_z_m: plate distance reported by the stage; used if the stream has none.
    """
    n_rotors = len(visit.pwm_us)
    names = [name for name in averaged_channels(n_rotors) if name in samples]
    columns = {name: samples.column(name) for name in names}
    if tare.calibration is not None:
        raw = samples.column("thrust_raw")
        columns["thrust_N"] = tare.calibration.newtons(raw, tare.zero_counts)
    means = {
        name: average(column, estimate_quantum(name, sensors)) for name, column in columns.items()
    }
    times_s = samples.column("time_s")
    time_s = float(times_s.mean()) if len(times_s) else nan
    none = Average(nan, nan, nan, 0)

    def mean(name: str, default: float = nan) -> float:
        channel = means.get(name, none)
        return channel.mean if channel.n else default

    thrust = means["thrust_N"]
    speeds = [means.get(f"rpm{rotor + 1}", none) for rotor in range(n_rotors)]
    thrust_s = times_s[np.isfinite(columns["thrust_N"])]
    aliased = [
        f"rotor {number} {text}"
        for number, speed in enumerate(speeds, 1)
        if (text := is_aliased(speed.mean, thrust_s))
    ]
    notes = [("suspect", f"point {visit.point}: {text}") for text in aliased]
    for name, channel in means.items():
        if text := channel.rejection(name):
            kind = "suspect" if channel.suspect else "outliers"
            notes.append((kind, f"point {visit.point}: {text}"))
    point = Point(
        point=visit.point,
        kind=visit.kind,
        setting=visit.setting,
        repeat=visit.repeat,
        time_s=time_s,
        elapsed_s=time_s - tare.time_s,
        pwm_us=visit.pwm_us,
        rpm=tuple(speed.mean for speed in speeds),
        rpm_se=tuple(speed.se for speed in speeds),
        thrust_N=thrust.mean,
        thrust_sd_N=thrust.sd,
        thrust_se_N=thrust.se,
        n_samples=thrust.n,
        plate_z_m=mean("plate_z_m", plate_stage_z_m),
        plate_stage_z_m=plate_stage_z_m,
        plate_read_z_m=mean("plate_z_m"),
        plate_x_m=mean("plate_x_m", visit.target_x_m),
        plate_tilt_deg=mean("plate_tilt_deg", visit.target_tilt_deg),
        voltage_V=mean("voltage_V"),
        current_A=mean("current_A"),
        torque_Nm=mean("torque_Nm"),
        temperature_degC=mean("temperature_degC"),
        settled=settled,
        rejected={name: channel.n_rejected for name, channel in means.items()},
        suspect=any(kind == "suspect" for kind, _ in notes),
        voltage_se_V=means.get("voltage_V", none).se,
        current_se_A=means.get("current_A", none).se,
        torque_se_Nm=means.get("torque_Nm", none).se,
    )
    return point, notes
