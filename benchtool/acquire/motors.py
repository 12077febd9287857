"""Bring rotors to a pulse, to a standstill, to rest, and end a run safely however it ends."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from math import isnan
from typing import TypeVar

import numpy as np

from benchtool.acquire.average import average
from benchtool.acquire.plan import CooldownPart
from benchtool.acquire.record import Recorder
from benchtool.core.array_type import Array
from benchtool.core.errors import BenchError, CommandRefused, RunInterrupted, StandstillNotConfirmed
from benchtool.core.recording import Recording
from benchtool.core.rig import Rig
from benchtool.data.run.points import Point

RAMP_STEP_S = 0.05  # between two pulses; far below the device's watchdog of 0.25 s; assumed
RAMP_DOWN_S = 0.8  # a normal end ramps down in so long; at most 1 s is allowed
POST_STOP_RECORDING_S = (
    0.5  # after an early stop the run records so long how pulses and speeds fall; assumed
)
STANDSTILL_RPM = 30.0  # a slower rotor stands still; tachometers flicker by 1 or 2; assumed


class Motors:
    """Command pulses through a recorder, remembering the last ones."""

    def __init__(self, recorder: Recorder, rig: Rig) -> None:
        self._recorder = recorder
        self._rig = rig
        self.stop_us: Array = np.full(rig.n_rotors, rig.propulsion.pwm_stop_us)
        self.pulses_us: Array = self.stop_us

    @property
    def stopped(self) -> bool:
        """Whether zero is commanded."""
        return bool(np.all(self.pulses_us == self.stop_us))

    def ramp_to(self, pulses_us: Array, seconds: float, phase: str, point: int = 0) -> None:
        """Go to pulses (n_rotors,) in equal steps, recording samples on the way."""
        # A ramp from standstill begins at the pulse where rotors start to turn.
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
        """Command zero at once."""
        self._set(self.stop_us)

    def stand_still(self, timeout_s: float, phase: str) -> None:
        """Command zero and wait until no rotor turns.

        Raises:
            BenchError: a rotor still turns after the time-out.
        """
        self.zero()
        end_s = self._recorder.bench.now_s() + timeout_s
        names = [f"rpm{rotor + 1}" for rotor in range(self._rig.n_rotors)]
        while True:
            seen = self._recorder.collect(phase, 0.2)
            last = {name: _last(seen.column(name)) for name in names if name in seen}
            if all(abs(rpm) < STANDSTILL_RPM for rpm in last.values()):
                return
            if self._recorder.bench.now_s() >= end_s:
                name, rpm = max(last.items(), key=lambda item: np.nan_to_num(abs(item[1]), nan=1e9))
                reading = f"still reads {rpm:.0f} rpm" if rpm == rpm else "brings no value"
                raise BenchError(
                    f"{name} {reading} {timeout_s:g} s after zero was commanded, limit "
                    f"{STANDSTILL_RPM:g} rpm; check the ESC's arming and the tachometer"
                )

    def _set(self, pulses_us: Array) -> None:
        try:
            self._recorder.bench.set_pwm(pulses_us)
        except CommandRefused:
            # A device that stopped by itself reports why in its stream; that is the better error.
            for _ in range(2):
                self._recorder.read("end", timeout_s=RAMP_STEP_S)
            raise
        self.pulses_us = pulses_us


def _last(values: Array) -> float:
    present = values[~np.isnan(values)]
    return float(present[-1]) if len(present) else float("nan")


Result = TypeVar("Result")


def run_to_end(
    recorder: Recorder,
    motors: Motors,
    measure: Callable[[], None],
    summarise: Callable[[], tuple[Result, str]],
    hold: Callable[[], object],
) -> Result:
    """Measure, ramp down, see the rotors stand, and close the run's files; return the summary.

    Whatever ends it early, zero is commanded first, then the reason is recorded, and it is raised
    again; only a normal end ramps down. The link is closed by who opened it.

    Args:
        summarise: called when the rotors stand; returns the summary and the text of the last event.
        hold: called after zero was commanded at an early end.
    """
    try:
        try:
            measure()
            motors.ramp_to(motors.stop_us, RAMP_DOWN_S, "end")
            recorder.bench.stop()
            recorder.see_standstill()
            recorder.bench.require_standstill(ends_normally=True)
            summary, text = summarise()
            recorder.note("ended", text)
            recorder.finish("ended")
        except BaseException as error:
            ended_by = _stop_at_once(recorder, error, hold)
            if ended_by is not error:
                raise ended_by from error
            raise
        return summary
    finally:
        recorder.close()


def _stop_at_once(
    recorder: Recorder, error: BaseException, hold: Callable[[], object]
) -> BaseException:
    """Command zero before anything else and return the error that ends the run.

    Nothing that fails on the way hides that error.
    """
    bench = recorder.bench
    with suppress(Exception):
        bench.stop()
    with suppress(Exception):
        hold()
    interrupted = isinstance(error, KeyboardInterrupt)
    reason = "stopped by Ctrl-C" if interrupted else str(error) or type(error).__name__
    with suppress(Exception):
        if unread := bench.take_unread():
            recorder.store(unread, "end")
    with suppress(Exception):
        # How the rotors slow down, and what waited in the link.
        if not isinstance(error, StandstillNotConfirmed):
            recorder.see_standstill(POST_STOP_RECORDING_S)
    if not isinstance(error, StandstillNotConfirmed):
        reason = bench.with_standstill(reason)
    with suppress(Exception):
        recorder.finish("stopped", reason)
    with suppress(Exception):
        recorder.note("stopped", reason)
    return recorder.rescue(error)


POLL_INTERVAL_S = 1.0  # span over which temperature and voltage are averaged; assumed


def cool_down_if_needed(
    recorder: Recorder, motors: Motors, plan: CooldownPart, last: Point | None
) -> None:
    """Rest where temperature or voltage of the last point requires it; look when there is none.

    Raises:
        RunInterrupted: the rest took longer than the plan allows.
    """
    if plan.above_degC is None and plan.below_V is None:
        return
    if last is None:
        seen = recorder.collect("rest", POLL_INTERVAL_S)
        why = _why(_mean(seen, "temperature_degC"), _mean(seen, "voltage_V"), plan)
    else:
        why = _why(last.temperature_degC, last.voltage_V, plan)
    if not why:
        return
    recorder.note("rest", f"{why}; motors at zero until it has recovered")
    motors.zero()
    begun_s = recorder.now_s
    while not _recovered(recorder.collect("rest", POLL_INTERVAL_S), plan):
        if recorder.now_s - begun_s > plan.longest_s:
            raise RunInterrupted(
                f"{why} and had not recovered after {plan.longest_s:g} s; cool it or change the "
                f"pack, then go on with benchtool sweep --resume"
            )
    recorder.note("rested", f"went on after {recorder.now_s - begun_s:.0f} s")


def _why(temperature: float, voltage: float, plan: CooldownPart) -> str:
    if plan.above_degC is not None and temperature > plan.above_degC:
        return f"the ESC reads {temperature:.1f} degC, rest above {plan.above_degC:g} degC"
    if plan.below_V is not None and voltage < plan.below_V:
        return f"the pack reads {voltage:.2f} V, rest below {plan.below_V:g} V"
    return ""


def _recovered(seen: Recording, plan: CooldownPart) -> bool:
    temperature, voltage = _mean(seen, "temperature_degC"), _mean(seen, "voltage_V")
    cool = plan.above_degC is None or isnan(temperature) or temperature <= plan.until_degC
    until_V = max(plan.until_V, plan.below_V or 0.0)
    charged = plan.below_V is None or isnan(voltage) or voltage >= until_V
    return cool and charged


def _mean(seen: Recording, name: str) -> float:
    return average(seen.column(name)).mean if name in seen else float("nan")
