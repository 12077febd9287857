"""A safe way to hold any bench: limits on every sample, and zero on every way out.

A `GuardedBench` is itself a bench. Entered as a context manager it ends in one of two ways: the
body came to its end, and the motors ramp down within a second; or anything else (an error, a
limit, Ctrl-C, SIGTERM, a closed terminal, a lost link), and zero is commanded at once, the plate
halted, the reason recorded. Either way the bench is then read until its rotors were seen to stand,
and the link closed. Signals are deferred from entering to leaving: the next command or read raises
them, so that they interrupt neither a stop nor the way of a sample to the disk.
"""

from __future__ import annotations

from collections.abc import Callable
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
from benchtool.bench.signals import StopSignals
from benchtool.bench.wrappers import send_halt
from benchtool.core.array_type import Array
from benchtool.core.errors import (
    BenchError,
    BenchtoolError,
    CommandRefused,
    HostSuspended,
    InputError,
    LinkLost,
    RunInterrupted,
)
from benchtool.core.plural import pluralize
from benchtool.core.rig import Limits, Rig

RAMP_S = 0.9  # a normal end takes this long from any throttle to zero

RAMP_STEPS = 10
REPLY_TIMEOUT_S = 1.5
"""A command is answered or given up within this, wall time: `where`, `arm` and `pwm`, each waited
for 5 x 100 ms. A pause of the host within it is noticed by the drivers, who see each round."""

SLOW_REPLY_S = 6.0
"""The same behind an autopilot: a loop that is armed first shows that once a second, and an
overfilled line or a router brings acknowledgements seconds late."""


class GuardedBench(MotorStateBench):
    """Watch over a bench.

    Args:
        stale_s: a channel without a new value for so long is dead.
    """

    def __init__(
        self, bench: Bench, rig: Rig, limits: Limits | None = None, stale_s: float = 1.0
    ) -> None:
        super().__init__(bench, rig)
        self._limits = rig.limits if limits is None else limits
        self._stale_s = stale_s
        self._check: LimitCheck | None = None
        self._pause: HostPauseMonitor | None = None
        self._age: ReadingAgeMonitor | None = None
        self._plate: PlateCheck | None = None
        self._unread: list[Readings] = []
        self._signals = StopSignals(self._note_reason)

    def open(self) -> None:
        self.bench.open()
        if (present := self.identity.n_rotors) != self._rig.n_rotors:
            raise InputError(
                f"rig {self._rig.name!r} has {pluralize(self._rig.n_rotors, 'rotor')}, but the "
                f"bench {self.identity.address} drives {present}; name the rig that stands on it"
            )
        self._begin()
        self._pause = HostPauseMonitor(self.identity, self.now_s())
        self._age = ReadingAgeMonitor(self.identity)
        self._check = LimitCheck(
            self.identity.channels, self._rig, self._limits, self._stale_s, self.now_s()
        )
        self._plate = PlateCheck(self.identity.channels, self._rig)
        if self.identity.has_loop:
            self.expect_loop()

    def expect_loop(self) -> None:
        """Judge speeds by the pulses that the bench reports, because a loop on it makes them.

        A bench that says of itself that it is a pitch bench is judged so from the beginning.
        """
        if self._check is not None and self._watch is not None:
            self._watch.expect_loop()
            self._check.expect_loop(self.now_s(), armed_else=self.identity.armed_by_operator)

    def tighten(self, limits: Limits) -> None:
        """Watch narrower limits from now on: anything up to the rig's, nothing beyond.

        Raises:
            InputError: a limit is looser than the rig's; nothing has changed.
        """
        for name, wanted in asdict(limits).items():
            stated, least = getattr(self._rig.limits, name), name == "voltage_min_V"
            if (wanted < stated) if least else (wanted > stated):
                raise InputError(
                    f"limits.{name} = {wanted:g} is looser than the rig's {stated:g}; give "
                    f"{'at least' if least else 'at most'} that, or change the rig file"
                )
        self._limits = limits
        if self._check is not None:
            self._check.tighten(limits)

    def close(self) -> None:
        self._check = self._watch = None
        self.bench.close()

    def set_pwm(self, pwm_us: Array) -> None:
        """Command every motor's pulse; nothing is sent that breaks `limits.pwm_us`."""
        self._refuse_after_stop("pwm")
        pulses = np.array(pwm_us, float).ravel()
        if len(pulses) != self._rig.n_rotors or not np.isfinite(pulses).all():
            raise InputError(
                f"pulses {pulses.tolist()} were not sent; {self._rig.n_rotors} finite ones are "
                f"needed, one for each rotor"
            )
        if (pulses > self._limits.pwm_us).any():
            motor = int(np.argmax(pulses))
            raise InputError(
                f"a pulse of {pulses[motor]:g} us for motor {motor + 1} was not sent, limit "
                f"{self._limits.pwm_us:g} us; lower it or raise limits.pwm_us"
            )
        self._end_if_paused()
        # Noted before it is sent: an acknowledgement that is lost may leave the motors turning.
        before = self._pwm_us
        self._note_command(pulses)
        late = self.identity.has_loop or self.identity.longest_delay_s > 0.0
        self._expect(wall_s=SLOW_REPLY_S if late else REPLY_TIMEOUT_S)
        try:
            self.bench.set_pwm(pulses)
        except CommandRefused:
            self._note_command(before)
            raise
        except (BenchError, HostSuspended) as error:
            self._end_if_paused(error)
            self._halt(error)
            raise
        self._end_if_paused()
        # Speeds are held against pulses from the acknowledgement on, which may take long.
        self._commanded_s = self.now_s()
        self._expect()

    def move_plate(self, z_m: float, x_m: float = 0.0, tilt_rad: float = 0.0) -> None:
        self.ready_for_move(z_m, x_m, tilt_rad)
        try:
            with self.interruptible():
                self.bench.move_plate(z_m, x_m, tilt_rad)
            self.confirm_plate(z_m, z_m)
        except BenchError as error:
            self._halt(error)
            raise

    def confirm_plate(self, target_m: float, stage_m: float, more_m: float = 0.0) -> None:
        """Compare target, stage and the bench's own reading, where there is one, after a move.

        `move_plate` does this by itself; whoever moves a separate stage asks for it afterwards.

        Raises:
            StageError: target, stage and reading disagree, or nothing was read.
        """
        if self._plate is None:
            return
        problem = wait_for_plate(self, self._plate, target_m, stage_m, more_m)
        if problem is not None:
            self._halt(problem)
            raise problem

    def ready_for_move(self, z_m: float, x_m: float = 0.0, tilt_rad: float = 0.0) -> None:
        """Allow the plate to move there: at idle throttle only, never inside the minimum gap.

        Waits for rotors that still turn; what is read meanwhile comes with the next `read`.
        `move_plate` asks this by itself; whoever moves a separate stage asks it first.

        Raises:
            StageError: motors above idle, rotors that do not slow down, or a place outside of the
                plate's travel.
        """
        self._refuse_after_stop("plate")
        check_travel(self._rig, z_m, x_m, tilt_rad)
        wait_for_idle(self, self._rig)
        if self._plate is not None:
            self._plate.departs()

    def tare(self) -> None:
        """Tare, with every motor commanded to stand still."""
        self._refuse_after_stop("tare")
        if (self._pwm_us > self._rig.propulsion.pwm_stop_us).any():
            raise InputError(
                f"no tare while motors are commanded {self._pwm_us.max():g} us; command "
                f"{self._rig.propulsion.pwm_stop_us:g} us first"
            )
        self.bench.tare()

    def set_rate(self, rate_Hz: float) -> None:
        self.bench.set_rate(rate_Hz)

    def read(self, timeout_s: float) -> Readings:
        """Return what arrived, every sample of it within its limits.

        Raises:
            LimitExceeded: a reading beyond its limit; zero was commanded before this was raised.
                The samples that show it are in `take_unread`.
            ReadingsLate: the same where readings stay late.
        """
        self._signals.raise_if_requested()
        new = self._read_checked(timeout_s)
        unread, self._unread = self._unread, []
        return concatenate_readings([*unread, new])

    def _read_checked(self, timeout_s: float) -> Readings:
        if self._check is None or self._age is None:
            raise LinkLost("a bench that is not open was read; open it first")
        self._end_if_paused()
        self._expect(bench_s=timeout_s)
        try:
            readings = self.bench.read(timeout_s)
        except (BenchError, HostSuspended) as error:
            self._end_if_paused(error)
            self._halt(error)
            raise
        self._end_if_paused(readings=readings)
        self._expect()
        assert self._watch is not None
        self._watch.take(readings.time_s, readings.values)
        self._check.commanded(self._pwm_us, self._commanded_s)
        now_s = self.now_s()
        self._age.note(readings.time_s, now_s)
        # No reading is newer than now, whatever its stamp.
        made_s = np.minimum(readings.time_s, now_s)
        breach = self._check.breach(made_s, readings.values, self._age.late)
        if breach is None and self._age.stays_late(now_s):
            breach = self._age.late
        if breach is not None:
            self._halt(breach)
            self._unread.append(readings)
            raise breach
        if self._plate is not None:
            self._plate.note(readings.values)
        return readings

    def listen(self, timeout_s: float) -> Readings:
        """Read and check as `read` does, and hold the samples for the next `read`.

        For whoever waits for something else, as for an operator.
        """
        self._signals.raise_if_requested()
        readings = self._read_checked(timeout_s)
        self._unread.append(readings)
        return readings

    def interruptible(self) -> AbstractContextManager[None]:
        """Let a signal raise at once within this scope; elsewhere the next command or read does.

        For waits that call neither, such as an operator's answer.
        """
        return self._signals.interruptible()

    def request_stop(self, reason: str) -> None:
        """Stop from any thread: the next command or read raises RunStopped.

        Zero is sent from the calling thread where the bench can do that.
        """
        self._signals.request(reason)
        send_halt(self.bench)

    def take_unread(self) -> Readings | None:
        """Return samples that were read but not handed out, such as those that broke a limit."""
        unread, self._unread = self._unread, []
        return concatenate_readings(unread) if unread else None

    def ramp_down(self, take: Callable[[Readings], None] | None = None) -> None:
        """Bring every motor to zero within a second, reading on."""
        top, end = self._pwm_us, np.full(self._rig.n_rotors, self._rig.propulsion.pwm_stop_us)
        if (top > end).any():
            for step in range(1, RAMP_STEPS + 1):
                self.set_pwm(top + (end - top) * (step / RAMP_STEPS))
                until_s = self.now_s() + RAMP_S / RAMP_STEPS
                while (left_s := until_s - self.now_s()) > 1e-9:
                    readings = self.read(left_s)
                    if take is not None:
                        take(readings)
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
        with ExitStack() as way_out:
            # Run in reverse: zero, standstill, the link, the signals, whatever fails in between.
            way_out.callback(self._signals.restore)
            way_out.callback(self._quietly, self.close, "closing the link")
            try:
                if error is None and self._check is not None and not self._stopped:
                    self.ramp_down()
            except BaseException as failed:
                self._end(failed)
                raise
            self._end(error)

    def _expect(self, wall_s: float = 0.0, bench_s: float = 0.0) -> None:
        if self._pause is not None:
            self._pause.expect(self.now_s(), wall_s, bench_s)

    def _end_if_paused(
        self, error: BenchtoolError | None = None, readings: Readings | None = None
    ) -> None:
        """Command zero where the host did not run while motors turned; late readings are held.

        Raises:
            HostSuspended: instead of whatever the pause made the device say.
        """
        paused = self._pause.late(self.now_s()) if self._pause is not None else None
        if paused is None:
            return
        self._expect()
        if not self._turning:
            return
        if readings is not None:
            self._unread.append(readings)
        self._halt(paused)
        raise paused from error

    def _refuse_after_stop(self, command: str) -> None:
        self._signals.raise_if_requested()
        if self._stopped:
            raise RunInterrupted(
                f"{command} was not sent: the bench was stopped ({self.reason}); open it anew"
            )
