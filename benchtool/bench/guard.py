"""Guarded bench: limits on every sample, and zero throttle on every exit.

A `GuardedBench` is itself a bench. After a body without error, leaving it ramps the motors down
within a second. After anything else (an error, a limit, Ctrl-C, SIGTERM, a closed terminal, a lost
link) zero is commanded at once, the plate is stopped and the reason is recorded. In both cases the
bench is then read until standstill is confirmed, and the link is closed. Signals are deferred from
entering to leaving: the next command or read raises them, so they interrupt neither a stop nor the
writing of a sample.
"""

from __future__ import annotations

from contextlib import AbstractContextManager, ExitStack
from dataclasses import asdict
from types import TracebackType
from typing import Self

import numpy as np

from benchtool.bench.bench import Bench, Readings, concatenate_readings
from benchtool.bench.clocks import HostPauseMonitor, ReadingAgeMonitor
from benchtool.bench.limit_check import LimitCheck
from benchtool.bench.motor_state import MotorStateBench
from benchtool.bench.plate_check import PlateCheck, check_travel, wait_for_idle, wait_for_plate
from benchtool.bench.stop_requests import StopSignals, send_halt
from benchtool.core.errors import (
    BenchError,
    BenchtoolError,
    CommandRefused,
    HostSuspended,
    InputError,
    LinkLost,
    RunInterrupted,
)
from benchtool.core.rig import Limits, Rig
from benchtool.core.units import Array

RAMP_S = 0.9  # duration of a normal ramp from any throttle to zero
RAMP_STEPS = 10

# Wall time within which a command is acknowledged or given up: `where`, `arm` and `pwm` wait for
# 5 x 100 ms each. The drivers notice a pause of the host within it, because they see each round.
REPLY_TIMEOUT_S = 1.5

# The same behind an autopilot: an armed loop is reported once a second, and an overfilled line or
# a router delays acknowledgements by seconds.
SLOW_REPLY_S = 6.0


class GuardedBench(MotorStateBench):
    """Wrapper that checks limits and guarantees a stop."""

    def __init__(
        self, bench: Bench, rig: Rig, limits: Limits | None = None, stale_s: float = 1.0
    ) -> None:
        super().__init__(bench, rig)
        self._limits = rig.limits if limits is None else limits
        self._stale_s = stale_s
        self._limit_check: LimitCheck | None = None
        self._host_pause: HostPauseMonitor | None = None
        self._reading_age: ReadingAgeMonitor | None = None
        self._plate_check: PlateCheck | None = None
        self._unread: list[Readings] = []
        self._signals = StopSignals(self._record_reason)

    def open(self) -> None:
        self.bench.open()
        if (present := self.identity.n_rotors) != self._rig.n_rotors:
            raise InputError(
                f"number of rotors differs: rig {self._rig.name!r} has {self._rig.n_rotors}, bench "
                f"{self.identity.address} has {present}; use the rig file of this bench"
            )
        self._begin()
        self._host_pause = HostPauseMonitor(self.identity, self.now_s())
        self._reading_age = ReadingAgeMonitor(self.identity)
        self._limit_check = LimitCheck(
            self.identity.channels, self._rig, self._limits, self._stale_s, self.now_s()
        )
        self._plate_check = PlateCheck(self.identity.channels, self._rig)
        if self.identity.has_loop:
            self.expect_loop()

    def expect_loop(self) -> None:
        """Compare speeds with the pulse widths that the bench reports, set by its control loop.

        A bench that identifies itself as a pitch bench is checked so from `open` on.
        """
        if self._limit_check is not None and self._monitor is not None:
            self._monitor.expect_loop()
            self._limit_check.expect_loop(self.now_s(), rc_arming=self.identity.armed_by_operator)

    def tighten_limits(self, limits: Limits) -> None:
        """Apply narrower limits from now on, up to the rig's limits.

        Raises:
            InputError: a limit is looser than the rig's; no limit was changed.
        """
        for name, value in asdict(limits).items():
            rig_limit, is_minimum = getattr(self._rig.limits, name), name == "voltage_min_V"
            if (value < rig_limit) if is_minimum else (value > rig_limit):
                raise InputError(
                    f"limits.{name} = {value:g} is looser than the rig's {rig_limit:g}; give "
                    f"{'at least' if is_minimum else 'at most'} that, or change the rig file"
                )
        self._limits = limits
        if self._limit_check is not None:
            self._limit_check.tighten_limits(limits)

    def close(self) -> None:
        self._limit_check = self._monitor = None
        self.bench.close()

    def set_pwm(self, pwm_us: Array) -> None:
        """Command the pulse width of every motor; nothing above `limits.pwm_us` is sent."""
        self._refuse_after_stop("pwm")
        command_pwm_us = np.array(pwm_us, float).ravel()
        if len(command_pwm_us) != self._rig.n_rotors or not np.isfinite(command_pwm_us).all():
            raise InputError(
                f"pulse widths {command_pwm_us.tolist()} us are invalid, command not sent; needed: "
                f"{self._rig.n_rotors} finite values, one for each rotor"
            )
        if (command_pwm_us > self._limits.pwm_us).any():
            motor = int(np.argmax(command_pwm_us))
            raise InputError(
                f"pulse width {command_pwm_us[motor]:g} us of motor {motor + 1} exceeds the limit "
                f"of {self._limits.pwm_us:g} us, command not sent; reduce it or raise limits.pwm_us"
            )
        self._end_if_paused()
        # Recorded before it is sent: motors may turn although the acknowledgement is lost.
        previous_us = self._pwm_us
        self._record_command(command_pwm_us)
        late = self.identity.has_loop or self.identity.longest_delay_s > 0.0
        self._expect(wall_s=SLOW_REPLY_S if late else REPLY_TIMEOUT_S)
        try:
            self.bench.set_pwm(command_pwm_us)
        except CommandRefused:
            self._record_command(previous_us)
            raise
        except (BenchError, HostSuspended) as error:
            self._end_if_paused(error)
            self._stop_once(error)
            raise
        self._end_if_paused()
        # Speeds are compared with pulse widths from the acknowledgement on, which may take long.
        self._commanded_s = self.now_s()
        self._expect()

    def move_plate(self, z_m: float, x_m: float = 0.0, tilt_rad: float = 0.0) -> None:
        self.check_ready_for_move(z_m, x_m, tilt_rad)
        try:
            with self.interruptible():
                self.bench.move_plate(z_m, x_m, tilt_rad)
            self.confirm_plate(z_m, z_m)
        except BenchError as error:
            self._stop_once(error)
            raise

    def confirm_plate(
        self, target_m: float, stage_m: float, extra_tolerance_m: float = 0.0
    ) -> None:
        """Compare target, stage position and plate reading (if there is one) after a move.

        `move_plate` includes this check; call it after moving a separate stage.

        Raises:
            StageError: target, stage and reading disagree, or there was no reading.
        """
        if self._plate_check is None:
            return
        problem = wait_for_plate(self, self._plate_check, target_m, stage_m, extra_tolerance_m)
        if problem is not None:
            self._stop_once(problem)
            raise problem

    def check_ready_for_move(self, z_m: float, x_m: float = 0.0, tilt_rad: float = 0.0) -> None:
        """Check that the plate may move: at idle throttle only, never below the minimum distance.

        Waits for rotors that still turn; the next `read` returns the samples of the wait.
        `move_plate` includes this check; call it before moving a separate stage.

        Raises:
            StageError: motors above idle, rotors that do not slow down, or a target outside the
                plate's travel range.
        """
        self._refuse_after_stop("plate")
        check_travel(self._rig, z_m, x_m, tilt_rad)
        wait_for_idle(self, self._rig)
        if self._plate_check is not None:
            self._plate_check.record_departure()

    def tare(self) -> None:
        """Tare the load cell; rejected unless every motor is commanded to stop."""
        self._refuse_after_stop("tare")
        if (self._pwm_us > self._rig.propulsion.pwm_stop_us).any():
            raise InputError(
                f"tare rejected: a motor is commanded to {self._pwm_us.max():g} us; allowed: "
                f"{self._rig.propulsion.pwm_stop_us:g} us; stop the motors first"
            )
        self.bench.tare()

    def set_rate(self, rate_Hz: float) -> None:
        self.bench.set_rate(rate_Hz)

    def read(self, timeout_s: float) -> Readings:
        """Return the received samples; all are within their limits.

        Raises:
            LimitExceeded: a reading exceeded its limit, and zero was commanded. `pop_unread`
                returns the samples that show it.
            ReadingsLate: the same for readings that stay late.
        """
        self._signals.raise_if_requested()
        new = self._read_checked(timeout_s)
        unread, self._unread = self._unread, []
        return concatenate_readings([*unread, new])

    def _read_checked(self, timeout_s: float) -> Readings:
        if self._limit_check is None or self._reading_age is None:
            raise LinkLost("read() needs an open bench; call open() first")
        self._end_if_paused()
        self._expect(bench_s=timeout_s)
        try:
            readings = self.bench.read(timeout_s)
        except (BenchError, HostSuspended) as error:
            self._end_if_paused(error)
            self._stop_once(error)
            raise
        self._end_if_paused(readings=readings)
        self._expect()
        assert self._monitor is not None
        self._monitor.update(readings.time_s, readings.values)
        self._limit_check.record_command(self._pwm_us, self._commanded_s)
        now_s = self.now_s()
        self._reading_age.update(readings.time_s, now_s)
        # No reading is newer than now, whatever its time stamp.
        sampled_s = np.minimum(readings.time_s, now_s)
        violation = self._limit_check.find_violation(
            sampled_s, readings.values, self._reading_age.late_error
        )
        if violation is None and self._reading_age.stays_late(now_s):
            violation = self._reading_age.late_error
        if violation is not None:
            self._stop_once(violation)
            self._unread.append(readings)
            raise violation
        if self._plate_check is not None:
            self._plate_check.update(readings.values)
        return readings

    def read_and_buffer(self, timeout_s: float) -> Readings:
        self._signals.raise_if_requested()
        readings = self._read_checked(timeout_s)
        self._unread.append(readings)
        return readings

    def interruptible(self) -> AbstractContextManager[None]:
        """Raise signals immediately inside this context; elsewhere the next command or read does.

        For waits that call neither, such as an operator's answer.
        """
        return self._signals.interruptible()

    def request_stop(self, reason: str) -> None:
        """Stop from any thread: the next command or read raises RunStopped.

        Zero is sent from the calling thread if the bench supports that.
        """
        self._signals.request(reason)
        send_halt(self.bench)

    def pop_unread(self) -> Readings | None:
        """Return and clear the unread samples, such as those that exceeded a limit."""
        unread, self._unread = self._unread, []
        return concatenate_readings(unread) if unread else None

    def ramp_down(self) -> None:
        """Ramp every motor to zero within a second while reading."""
        start_us = self._pwm_us
        stop_us = np.full(self._rig.n_rotors, self._rig.propulsion.pwm_stop_us)
        if (start_us > stop_us).any():
            for step in range(1, RAMP_STEPS + 1):
                self.set_pwm(start_us + (stop_us - start_us) * (step / RAMP_STEPS))
                step_end_s = self.now_s() + RAMP_S / RAMP_STEPS
                while (left_s := step_end_s - self.now_s()) > 1e-9:
                    self.read(left_s)
        self.stop()

    def __enter__(self) -> Self:
        with ExitStack() as on_failure:
            on_failure.callback(self._signals.restore)
            self._signals.install()
            on_failure.callback(self.bench.close)
            with self.interruptible():
                self.open()
            on_failure.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        with ExitStack() as cleanup:
            # Run in reverse order: zero, standstill, link, signals, also if one of them fails.
            cleanup.callback(self._signals.restore)
            cleanup.callback(self._run_and_collect_error, self.close, "closing the link")
            try:
                if error is None and self._limit_check is not None and not self._stopped:
                    self.ramp_down()
            except BaseException as failure:
                self._stop_and_require_standstill(failure)
                raise
            self._stop_and_require_standstill(error)

    def _expect(self, wall_s: float = 0.0, bench_s: float = 0.0) -> None:
        if self._host_pause is not None:
            self._host_pause.expect(self.now_s(), wall_s, bench_s)

    def _end_if_paused(
        self, error: BenchtoolError | None = None, readings: Readings | None = None
    ) -> None:
        """Command zero if the host was paused while motors turned; late readings are buffered.

        Raises:
            HostSuspended: replaces any error that the device reported because of the pause.
        """
        pause_error = (
            self._host_pause.find_late_error(self.now_s()) if self._host_pause is not None else None
        )
        if pause_error is None:
            return
        self._expect()
        if not self._turning:
            return
        if readings is not None:
            self._unread.append(readings)
        self._stop_once(pause_error)
        raise pause_error from error

    def _refuse_after_stop(self, command: str) -> None:
        self._signals.raise_if_requested()
        if self._stopped:
            raise RunInterrupted(
                f"{command} was not sent: the bench was stopped ({self.reason}); open it again"
            )
