"""Commanded motor state: last pulse widths, emergency stop and standstill check."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress

import numpy as np

from benchtool.bench.bench import Bench, DeviceInfo, Readings
from benchtool.bench.standstill import Standstill, StandstillMonitor
from benchtool.core.errors import StandstillNotConfirmed
from benchtool.core.rig import Rig
from benchtool.core.units import Array

STANDSTILL_TIMEOUT_S = 0.1  # watched beyond the longest delay of a late command; assumed


class MotorStateBench(ABC):
    """Base class that records motor commands and stops the motors."""

    def __init__(self, bench: Bench, rig: Rig) -> None:
        self.bench = bench
        self.reason: str | None = None
        self.cleanup_errors: list[str] = []
        self._rig = rig
        self._monitor: StandstillMonitor | None = None
        self._standstill: Standstill | None = None
        self._pwm_us = self._zero_us()
        self._commanded_s = 0.0
        self._stopped = False

    def _begin(self) -> None:
        self._commanded_s = self.now_s()
        self._monitor = StandstillMonitor(self.identity, self._rig, self.now_s())
        self._standstill = None

    @property
    def identity(self) -> DeviceInfo:
        return self.bench.identity

    @property
    def pwm_us(self) -> Array:
        """The last commanded pulse widths (n_rotors,): us."""
        return self._pwm_us.copy()

    @property
    def standstill(self) -> Standstill | None:
        """Standstill check since zero was commanded; None while a motor is driven."""
        if self._standstill is not None or self._monitor is None or self._turning:
            return self._standstill
        return self._monitor.state()

    @property
    def _turning(self) -> bool:
        return bool((self._pwm_us > self._rig.propulsion.pwm_stop_us).any())

    def now_s(self) -> float:
        return self.bench.now_s()

    @abstractmethod
    def read_and_buffer(self, timeout_s: float) -> Readings:
        """Read and check as `read` does, and buffer the samples for the next `read`.

        For waits such as an operator's answer.
        """

    def stop(self) -> None:
        self._record_command(self._zero_us())
        self.bench.stop()

    def stop_and_check_standstill(
        self, on_readings: Callable[[Readings], object] | None = None, min_duration_s: float = 0.0
    ) -> Standstill:
        """Command zero and read until standstill is confirmed or times out; never raises.

        Leaving the guard includes this, unless it was done since a motor was last driven.
        Limits are no longer checked, because all motors are already commanded to stop.
        """
        assert self._monitor is not None
        if self._turning:
            self._record_command(self._zero_us())
            self._run_and_collect_error(self.bench.stop, "commanding zero")
        if (delay_s := self.identity.longest_delay_s) > 0.0:
            min_duration_s = max(min_duration_s, delay_s + STANDSTILL_TIMEOUT_S)
        self._standstill = wait_for_standstill(
            self.bench, self._monitor, on_readings, min_duration_s
        )
        return self._standstill

    def require_standstill(self, ends_normally: bool = False) -> None:
        """Raise if the last standstill check failed.

        Args:
            ends_normally: rotors without a speed channel then pass.

        Raises:
            StandstillNotConfirmed: contains the readings and the reason of the end of the run.
        """
        state = self._standstill
        if state is None or state.is_confirmed or (ends_normally and state.is_only_unmeasured):
            return
        error = StandstillNotConfirmed(self.add_standstill_text(self.reason or ""), state.rpm)
        self._stop_once(error)
        raise error

    def check_standstill(self) -> None:
        """Raise if a rotor still turns `SPIN_DOWN_S` after zero was commanded.

        For reads that continue after a stop. Rotors without a speed channel pass.

        Raises:
            StandstillNotConfirmed: contains the readings; zero was commanded again.
        """
        if self._turning or self._monitor is None or self._standstill is not None:
            return
        now_s = self.now_s()
        state = self._monitor.state()
        if (
            now_s - self._monitor.zero_s < SPIN_DOWN_S
            or state.is_confirmed
            or state.is_only_unmeasured
        ):
            return
        self._standstill = state
        self.require_standstill()

    def add_standstill_text(self, reason: str) -> str:
        """Return why a run ended, preceded by the rotors without confirmed standstill."""
        state = self._standstill
        if state is None or state.is_confirmed:
            return reason
        return f"{state.text}; the run ended because: {reason}" if reason else state.text

    def _stop_and_require_standstill(self, error: BaseException | None) -> None:
        """Command zero unless that was done, and read until standstill is confirmed.

        Raises:
            StandstillNotConfirmed: standstill was not confirmed; the error is its cause.
        """
        if error is not None or self._turning:
            self._stop_once(error)
        if self._monitor is None:
            return
        if self._standstill is None:
            self.stop_and_check_standstill()
        if isinstance(error, StandstillNotConfirmed):
            return
        try:
            self.require_standstill(ends_normally=error is None)
        except StandstillNotConfirmed as standstill_error:
            raise standstill_error from error

    def _stop_once(self, error: BaseException | None) -> None:
        """Command zero, only once, and record the reason."""
        if error is not None:
            self._record_reason(_error_text(error))
        if self._stopped:
            return
        self._stopped = True
        self._record_command(self._zero_us())
        self._run_and_collect_error(self.bench.stop, "commanding zero")

    def _zero_us(self) -> Array:
        return np.full(self._rig.n_rotors, self._rig.propulsion.pwm_stop_us)

    def _record_command(self, pulses_us: Array) -> None:
        self._pwm_us, self._commanded_s = pulses_us, self.now_s()
        if self._monitor is not None:
            self._monitor.record_command(pulses_us, self._commanded_s)
        if self._turning:
            self._standstill = None

    def _run_and_collect_error(self, action: Callable[[], None], description: str) -> None:
        """Run an action; store its error instead of raising over the exception in flight."""
        try:
            action()
        except Exception as error:  # noqa: BLE001 -- nothing may skip the remaining cleanup
            self.cleanup_errors.append(f"{description} failed: {_error_text(error)}")

    def _record_reason(self, reason: str) -> None:
        if self.reason is None:
            self.reason = reason


def _error_text(error: BaseException) -> str:
    if isinstance(error, KeyboardInterrupt):
        return "stopped by Ctrl-C"
    return " ".join(str(error).split()) or type(error).__name__


SPIN_DOWN_S = 4.0  # longest coasting time after a stop; small rotors take about 1 s; assumed
REPEAT_INTERVAL_S = 1.0  # zero is commanded again until standstill is confirmed; assumed
POLL_INTERVAL_S = 0.05
FAILURES = 5  # failed reads in a row that end the check; each one commands zero and waits for it


def wait_for_standstill(
    bench: Bench,
    monitor: StandstillMonitor,
    on_readings: Callable[[Readings], object] | None = None,
    min_duration_s: float = 0.0,
) -> Standstill:
    """Read after zero was commanded until standstill of every driven rotor is confirmed.

    Zero is commanded again meanwhile. The check ends after `SPIN_DOWN_S`, or if the link brings no
    more readings. Never raises.

    Args:
        bench: the driver, not its guard, whose reads would raise the reason of the stop.
        monitor: monitor that has received all commands and readings so far.
    """
    start_s = last_command_s = bench.now_s()
    failures = 0
    while failures < FAILURES:
        now_s = bench.now_s()
        state = monitor.state()
        elapsed_s = now_s - start_s
        is_finished = state.is_confirmed or state.is_only_unmeasured or elapsed_s >= SPIN_DOWN_S
        left_s = min_duration_s - elapsed_s
        if is_finished and left_s <= 1e-9:
            break
        if not state.is_confirmed and now_s - last_command_s >= REPEAT_INTERVAL_S:
            last_command_s = now_s
            _command_zero(bench)
        try:
            readings = bench.read(
                min(POLL_INTERVAL_S, left_s) if left_s > 1e-9 else POLL_INTERVAL_S
            )
        except Exception:  # noqa: BLE001 -- nothing may hide the reason of the stop
            failures += 1
            _command_zero(bench)
            continue
        failures = 0
        monitor.update(readings.time_s, readings.values)
        if on_readings is not None:
            with suppress(Exception):
                on_readings(readings)
    return monitor.state()


def _command_zero(bench: Bench) -> None:
    with suppress(Exception):
        bench.stop()
