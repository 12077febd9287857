"""Operations between the points of a run: ramps, standstill, tare and cooldown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isnan, nan

import numpy as np

from benchtool.acquire.average import Average, average, estimate_quantum
from benchtool.acquire.plan import CooldownPart, TarePart
from benchtool.acquire.record import Recorder
from benchtool.core.errors import BenchError, CommandRefused, RunInterrupted
from benchtool.core.recording import Recording
from benchtool.core.rig import Rig
from benchtool.core.units import Array
from benchtool.data.calibration import Calibration
from benchtool.data.run.points import Point

RAMP_STEP_S = 0.05  # between pulses; far below the device watchdog of 0.25 s; assumed
STANDSTILL_RPM = 30.0  # slower rotors are at standstill; tachometer noise is 1 to 2 rpm; assumed
MAX_TARES = 3  # a gust fails one tare, a loose cell all; assumed
POLL_INTERVAL_S = 1.0  # averaging time of temperature and voltage; assumed


@dataclass(frozen=True, slots=True)
class TareResult:
    """Zero of the load cell after a tare.

    Attributes:
        time_s: middle of the averaging time after it, run time.
        zero_counts: mean raw reading of the unloaded cell; nan without raw counts.
        rates_Hz: rate of values of each channel.
        calibration: of the raw counts; None: the device's thrust is used.
    """

    time_s: float
    zero_counts: float
    rates_Hz: Mapping[str, float] = field(default_factory=dict)
    calibration: Calibration | None = None


class Motors:
    """Motor commands of a recorder, with the last pulses."""

    def __init__(self, recorder: Recorder, rig: Rig) -> None:
        self._recorder = recorder
        self._rig = rig
        self.stop_us: Array = np.full(rig.n_rotors, rig.propulsion.pwm_stop_us)
        self.pulses_us: Array = self.stop_us

    def ramp_to(self, pulses_us: Array, seconds: float, phase: str, point: int = 0) -> None:
        """Ramp to pulses (n_rotors,) in equal steps, while recording."""
        # A ramp from standstill starts at the pulse where rotors begin to turn.
        start_us = np.where(
            pulses_us > self.stop_us, self._rig.propulsion.pwm_start_us, self.stop_us
        )
        start_us = np.maximum(self.pulses_us, start_us)
        steps = max(1, round(seconds / RAMP_STEP_S))
        for step in range(1, steps + 1):
            now_us = start_us + (pulses_us - start_us) * (step / steps)
            now_us = np.where(pulses_us == self.stop_us, np.maximum(now_us, self.stop_us), now_us)
            self._set(pulses_us if step == steps else now_us)
            if steps > 1:
                self._recorder.collect(phase, RAMP_STEP_S, point)

    def zero(self) -> None:
        """Command zero throttle immediately."""
        self._set(self.stop_us)

    def stand_still(self, timeout_s: float, phase: str) -> None:
        """Command zero and wait for standstill.

        Raises:
            BenchError: a rotor still turns after the timeout.
        """
        self.zero()
        end_s = self._recorder.bench.now_s() + timeout_s
        names = [f"rpm{rotor + 1}" for rotor in range(self._rig.n_rotors)]
        while True:
            samples = self._recorder.collect(phase, 0.2)
            last = {name: _last(samples.column(name)) for name in names if name in samples}
            if all(abs(rpm) < STANDSTILL_RPM for rpm in last.values()):
                return
            if self._recorder.bench.now_s() >= end_s:
                name, rpm = max(last.items(), key=lambda item: np.nan_to_num(abs(item[1]), nan=1e9))
                reading = f"still reads {rpm:.0f} rpm" if rpm == rpm else "has no value"
                raise BenchError(
                    f"standstill not confirmed: {name} {reading} {timeout_s:g} s after zero "
                    f"throttle, limit {STANDSTILL_RPM:g} rpm; check ESC arming and tachometer"
                )

    def _set(self, pulses_us: Array) -> None:
        try:
            self._recorder.bench.set_pwm(pulses_us)
        except CommandRefused:
            # A stopped device sends the reason in its stream, which is the better error.
            for _ in range(2):
                self._recorder.read("end", timeout_s=RAMP_STEP_S)
            raise
        self.pulses_us = pulses_us

    def tare(self, plan: TarePart, calibration: Calibration | None) -> TareResult:
        """Wait for standstill, tare, check the remaining offset and append it to the points.

        Raises:
            BenchError: a rotor turns, no thrust values, or the offset stays above the limit.
        """
        recorder, rig = self._recorder, self._rig
        assert plan.residual_N is not None
        self.stand_still(plan.stop_timeout_s, "tare")
        offset = Average(nan, nan, nan, 0)
        for attempt in range(1, MAX_TARES + 1):
            recorder.bench.tare()
            # Discard samples that were in transit during the tare.
            recorder.collect("tare", 0.2)
            samples = recorder.collect("tare", plan.seconds)
            offset = average(samples.column("thrust_N"), estimate_quantum("thrust_N", rig.sensors))
            if text := offset.rejection("thrust_N"):
                recorder.record_event("suspect" if offset.suspect else "outliers", f"tare: {text}")
            if offset.n == 0:
                raise BenchError(
                    f"no load cell value within {plan.seconds:g} s after the tare; check the wiring"
                )
            if abs(offset.mean) <= plan.residual_N:
                middle_s = float(samples.column("time_s").mean())
                recorder.record_event(
                    "tare", f"tared; remaining offset {offset.mean * 1000.0:+.1f} mN"
                )
                values_Hz = np.isfinite(samples.values).sum(axis=0) / plan.seconds
                rates_Hz = dict(zip(samples.names, values_Hz.tolist(), strict=True))
                recorder.append_point(tare_point(middle_s, offset, rig.n_rotors))
                return TareResult(middle_s, _mean(samples, "thrust_raw"), rates_Hz, calibration)
            recorder.record_event(
                "tare_residual",
                f"tare {attempt} of {MAX_TARES}: remaining offset {offset.mean:+.4g} N, limit "
                f"{plan.residual_N:.4g} N",
            )
        raise BenchError(
            f"load cell offset {offset.mean:+.4g} N after {MAX_TARES} tares, limit "
            f"{plan.residual_N:.4g} N; warm up the cell, shield it from draught, or raise "
            f"tare.residual_N"
        )

    def cool_down_if_needed(self, plan: CooldownPart, last: Point | None) -> None:
        """Cool down if temperature or voltage of the last point requires it, or of new samples.

        Raises:
            RunInterrupted: cooldown timeout.
        """
        recorder = self._recorder
        if plan.above_degC is None and plan.below_V is None:
            return
        if last is None:
            samples = recorder.collect("rest", POLL_INTERVAL_S)
            temperature, voltage = _mean(samples, "temperature_degC"), _mean(samples, "voltage_V")
        else:
            temperature, voltage = last.temperature_degC, last.voltage_V
        if plan.above_degC is not None and temperature > plan.above_degC:
            reason = f"ESC temperature {temperature:.1f} degC is above {plan.above_degC:g} degC"
        elif plan.below_V is not None and voltage < plan.below_V:
            reason = f"battery voltage {voltage:.2f} V is below {plan.below_V:g} V"
        else:
            return
        recorder.record_event("rest", f"{reason}; motors at zero until it has recovered")
        self.zero()
        start_s = recorder.now_s
        while not _has_recovered(recorder.collect("rest", POLL_INTERVAL_S), plan):
            if recorder.now_s - start_s > plan.longest_s:
                raise RunInterrupted(
                    f"cooldown timeout after {plan.longest_s:g} s: {reason}; cool the motors or "
                    f"change the battery, then use benchtool sweep --resume"
                )
        recorder.record_event("rested", f"resumed after {recorder.now_s - start_s:.0f} s")


def _has_recovered(samples: Recording, plan: CooldownPart) -> bool:
    temperature, voltage = _mean(samples, "temperature_degC"), _mean(samples, "voltage_V")
    is_cool = plan.above_degC is None or isnan(temperature) or temperature <= plan.until_degC
    until_V = max(plan.until_V, plan.below_V or 0.0)
    is_charged = plan.below_V is None or isnan(voltage) or voltage >= until_V
    return is_cool and is_charged


def _last(values: Array) -> float:
    present = values[~np.isnan(values)]
    return float(present[-1]) if len(present) else nan


def _mean(samples: Recording, name: str) -> float:
    return average(samples.column(name)).mean if name in samples else nan


def tare_point(time_s: float, offset: Average, n_rotors: int) -> Point:
    """Return the row of points.csv that stores the remaining offset of a tare."""
    return Point(
        point=0,
        kind="tare",
        setting=0,
        repeat=0,
        time_s=time_s,
        elapsed_s=0.0,
        pwm_us=(nan,) * n_rotors,
        rpm=(0.0,) * n_rotors,
        rpm_se=(0.0,) * n_rotors,
        thrust_N=offset.mean,
        thrust_sd_N=offset.sd,
        thrust_se_N=offset.se,
        n_samples=offset.n,
        plate_z_m=nan,
        plate_x_m=nan,
        plate_tilt_deg=nan,
        rejected={"thrust_N": offset.n_rejected},
        suspect=offset.suspect,
    )


def format_drift(first: Point | None, anchor: Point, limit_N: float | None) -> str:
    """Return the reason for a tare after this anchor; "" if none is due.

    Thrust is scaled to the squared speeds of the first anchor, so that voltage sag is not mistaken
    for drift of the load cell.
    """
    if limit_N is None or first is None:
        return ""
    scale = 1.0
    if first.sum_rpm2 > 0.0 and anchor.sum_rpm2 > 0.0:
        scale = first.sum_rpm2 / anchor.sum_rpm2
    change_N = anchor.thrust_N * scale - first.thrust_N
    if abs(change_N) <= limit_N:
        return ""
    return (
        f"anchor {anchor.repeat} has changed by {change_N:+.4g} N since the first, limit "
        f"{limit_N:g} N; tare is repeated"
    )
