"""Motor commands of a run: ramps, standstill and cooldown."""

from __future__ import annotations

from math import isnan

import numpy as np

from benchtool.acquire.average import average
from benchtool.acquire.plan import CooldownPart
from benchtool.acquire.record import Recorder
from benchtool.core.errors import BenchError, CommandRefused, RunInterrupted
from benchtool.core.recording import Recording
from benchtool.core.rig import Rig
from benchtool.core.units import Array
from benchtool.data.run.points import Point

RAMP_STEP_S = 0.05  # between pulses; far below the device watchdog of 0.25 s; assumed
STANDSTILL_RPM = 30.0  # slower rotors are at standstill; tachometer noise is 1 to 2 rpm; assumed


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


def _last(values: Array) -> float:
    present = values[~np.isnan(values)]
    return float(present[-1]) if len(present) else float("nan")


POLL_INTERVAL_S = 1.0  # averaging time of temperature and voltage; assumed


def cool_down_if_needed(
    recorder: Recorder, motors: Motors, plan: CooldownPart, last: Point | None
) -> None:
    """Cool down if temperature or voltage of the last point requires it, or of new samples.

    Raises:
        RunInterrupted: cooldown timeout.
    """
    if plan.above_degC is None and plan.below_V is None:
        return
    if last is None:
        samples = recorder.collect("rest", POLL_INTERVAL_S)
        temperature, voltage = _mean(samples, "temperature_degC"), _mean(samples, "voltage_V")
        reason = _cooldown_reason(temperature, voltage, plan)
    else:
        reason = _cooldown_reason(last.temperature_degC, last.voltage_V, plan)
    if not reason:
        return
    recorder.record_event("rest", f"{reason}; motors at zero until it has recovered")
    motors.zero()
    start_s = recorder.now_s
    while not _has_recovered(recorder.collect("rest", POLL_INTERVAL_S), plan):
        if recorder.now_s - start_s > plan.longest_s:
            raise RunInterrupted(
                f"cooldown timeout after {plan.longest_s:g} s: {reason}; cool the motors or change "
                f"the battery, then use benchtool sweep --resume"
            )
    recorder.record_event("rested", f"resumed after {recorder.now_s - start_s:.0f} s")


def _cooldown_reason(temperature: float, voltage: float, plan: CooldownPart) -> str:
    if plan.above_degC is not None and temperature > plan.above_degC:
        return f"ESC temperature {temperature:.1f} degC is above {plan.above_degC:g} degC"
    if plan.below_V is not None and voltage < plan.below_V:
        return f"battery voltage {voltage:.2f} V is below {plan.below_V:g} V"
    return ""


def _has_recovered(samples: Recording, plan: CooldownPart) -> bool:
    temperature, voltage = _mean(samples, "temperature_degC"), _mean(samples, "voltage_V")
    is_cool = plan.above_degC is None or isnan(temperature) or temperature <= plan.until_degC
    until_V = max(plan.until_V, plan.below_V or 0.0)
    is_charged = plan.below_V is None or isnan(voltage) or voltage >= until_V
    return is_cool and is_charged


def _mean(samples: Recording, name: str) -> float:
    return average(samples.column(name)).mean if name in samples else float("nan")
