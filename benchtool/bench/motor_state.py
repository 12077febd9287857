"""What the motors of a bench were commanded, zero at once, and whether their rotors then stood."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

import numpy as np

from benchtool.bench.bench import Bench, DeviceInfo, Readings
from benchtool.bench.standstill import Standstill, StandstillMonitor
from benchtool.core.array_type import Array
from benchtool.core.errors import StandstillNotConfirmed
from benchtool.core.rig import Rig

STANDSTILL_TIMEOUT_S = (
    0.1  # extra watch over the longest delay seen, where an order may be late; assumed
)


class MotorStateBench:
    """Record what the motors were commanded and stop them for good."""

    def __init__(self, bench: Bench, rig: Rig) -> None:
        self.bench = bench
        self.reason: str | None = None
        self.troubles: list[str] = []
        self._rig = rig
        self._watch: StandstillMonitor | None = None
        self._looked: Standstill | None = None
        self._pwm_us = self._zero_us()
        self._commanded_s = 0.0
        self._stopped = False

    def _begin(self) -> None:
        self._commanded_s = self.now_s()
        self._watch = StandstillMonitor(self.identity, self._rig, self.now_s())
        self._looked = None

    @property
    def identity(self) -> DeviceInfo:
        return self.bench.identity

    @property
    def pwm_us(self) -> Array:
        """The last commanded pulses (n_rotors,): us."""
        return self._pwm_us.copy()

    @property
    def standstill(self) -> Standstill | None:
        """What was seen of the rotors since zero was commanded; None while a motor is driven."""
        if self._looked is not None or self._watch is None or self._turning:
            return self._looked
        return self._watch.state()

    @property
    def _turning(self) -> bool:
        return bool((self._pwm_us > self._rig.propulsion.pwm_stop_us).any())

    def now_s(self) -> float:
        return self.bench.now_s()

    def stop(self) -> None:
        self._note_command(self._zero_us())
        self.bench.stop()

    def see_standstill(
        self, take: Callable[[Readings], object] | None = None, at_least_s: float = 0.0
    ) -> Standstill:
        """Command zero and read on until the rotors were seen to stand; never raises.

        Leaving the guard does this by itself unless it was done since a motor was driven last.
        Limits are not checked any more: there is nothing left to stop.
        """
        assert self._watch is not None
        if self._turning:
            self._note_command(self._zero_us())
            self._quietly(self.bench.stop, "commanding zero")
        if (delay_s := self.identity.longest_delay_s) > 0.0:
            at_least_s = max(at_least_s, delay_s + STANDSTILL_TIMEOUT_S)
        self._looked = wait_for_standstill(self.bench, self._watch, take, at_least_s)
        return self._looked

    def require_standstill(self, ends_normally: bool = False) -> None:
        """Refuse to call motors stopped that were not seen to stand.

        Args:
            ends_normally: rotors that no channel measures are then no error.

        Raises:
            StandstillNotConfirmed: what was seen, and why the run ended.
        """
        state = self._looked
        if state is None or state.seen or (ends_normally and state.only_unmeasured):
            return
        unseen = StandstillNotConfirmed(self.with_standstill(self.reason or ""), state.rpm)
        self._halt(unseen)
        raise unseen

    def check_standstill(self) -> None:
        """Refuse to go on with a rotor that does not stand `SPIN_DOWN_S` after zero was commanded.

        For whoever reads on after a stop. Rotors that no channel measures pass.

        Raises:
            StandstillNotConfirmed: what was seen; zero was commanded again.
        """
        if self._turning or self._watch is None or self._looked is not None:
            return
        now_s = self.now_s()
        state = self._watch.state()
        if now_s - self._watch.zero_s < SPIN_DOWN_S or state.seen or state.only_unmeasured:
            return
        self._looked = state
        self.require_standstill()

    def with_standstill(self, reason: str) -> str:
        """Return why a run ended, after the rotors that were not seen to stand."""
        state = self._looked
        if state is None or state.seen:
            return reason
        return f"{state.text}; the run ended because: {reason}" if reason else state.text

    def _end(self, error: BaseException | None) -> None:
        """Command zero unless it is, and look until the rotors stand.

        Raises:
            StandstillNotConfirmed: they were not seen to stand; the error is its cause.
        """
        if error is not None or self._turning:
            self._halt(error)
        if self._watch is None:
            return
        if self._looked is None:
            self.see_standstill()
        if isinstance(error, StandstillNotConfirmed):
            return
        try:
            self.require_standstill(ends_normally=error is None)
        except StandstillNotConfirmed as unseen:
            raise unseen from error

    def _halt(self, error: BaseException | None) -> None:
        """Command zero at once, and only once; note why."""
        if error is not None:
            self._note_reason(_words(error))
        if self._stopped:
            return
        self._stopped = True
        self._note_command(self._zero_us())
        self._quietly(self.bench.stop, "commanding zero")

    def _zero_us(self) -> Array:
        return np.full(self._rig.n_rotors, self._rig.propulsion.pwm_stop_us)

    def _note_command(self, pulses_us: Array) -> None:
        self._pwm_us, self._commanded_s = pulses_us, self.now_s()
        if self._watch is not None:
            self._watch.commanded(pulses_us, self._commanded_s)
        if self._turning:
            self._looked = None

    def _quietly(self, action: Callable[[], None], what: str) -> None:
        """Act without raising over the error that is already on its way."""
        try:
            action()
        except Exception as error:  # noqa: BLE001 -- nothing may skip the rest of the way out
            self.troubles.append(f"{what} failed: {_words(error)}")

    def _note_reason(self, reason: str) -> None:
        if self.reason is None:
            self.reason = reason


def _words(error: BaseException) -> str:
    if isinstance(error, KeyboardInterrupt):
        return "stopped by Ctrl-C"
    return " ".join(str(error).split()) or type(error).__name__


SPIN_DOWN_S = 4.0  # rotors must stand so long after a stop: small ones take about 1 s; assumed
REPEAT_INTERVAL_S = (
    1.0  # zero is commanded again so often while a rotor is not seen to stand; assumed
)

POLL_INTERVAL_S = 0.05
FAILURES = 5
"""After so many reads in a row that failed, nothing more can be seen; each failure commands zero
again, which waits for its answer."""


def wait_for_standstill(
    bench: Bench,
    watch: StandstillMonitor,
    take: Callable[[Readings], object] | None = None,
    at_least_s: float = 0.0,
) -> Standstill:
    """Read on after zero was commanded until every rotor that was driven was seen to stand.

    Zero is commanded again while that is not seen, and it is given up after `SPIN_DOWN_S`, or when
    the link brings nothing any more. Never raises.

    Args:
        bench: the one on the wire, not its guard, which would raise why it was stopped.
        watch: has followed commands and readings so far.
        take: is given every block that is read.
        at_least_s: read on for so long in any case.
    """
    begun_s = sent_s = bench.now_s()
    failures = 0
    while failures < FAILURES:
        now_s = bench.now_s()
        state = watch.state()
        passed_s = now_s - begun_s
        over = state.seen or state.only_unmeasured or passed_s >= SPIN_DOWN_S
        left_s = at_least_s - passed_s
        if over and left_s <= 1e-9:
            break
        if not state.seen and now_s - sent_s >= REPEAT_INTERVAL_S:
            sent_s = now_s
            _command_zero(bench)
        try:
            readings = bench.read(
                min(POLL_INTERVAL_S, left_s) if left_s > 1e-9 else POLL_INTERVAL_S
            )
        except Exception:  # noqa: BLE001 -- nothing may hide why zero was commanded
            failures += 1
            _command_zero(bench)
            continue
        failures = 0
        watch.take(readings.time_s, readings.values)
        if take is not None:
            with suppress(Exception):
                take(readings)
    return watch.state()


def _command_zero(bench: Bench) -> None:
    with suppress(Exception):
        bench.stop()
