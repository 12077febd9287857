"""Stop motors and read on until their rotors are seen to stand."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

from benchtool.bench.bench import Bench, Readings
from benchtool.bench.standstill import Standstill, StandstillWatch

SPIN_DOWN_S = 4.0
"""Rotors that are told to stop must be seen to stand by then. A choice: small rotors need about 1 s
without a brake, the virtual ones 0.1 to 0.4 s."""

REPEAT_S = 1.0
"""Zero is commanded again so often while a rotor is not seen to stand; a choice."""

LOOK_S = 0.05
FAILURES = 5
"""After so many reads in a row that failed, nothing more can be seen; each failure commands zero
again, which waits for its answer."""


def see_standstill(
    bench: Bench,
    watch: StandstillWatch,
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
        if not state.seen and now_s - sent_s >= REPEAT_S:
            sent_s = now_s
            _command_zero(bench)
        try:
            readings = bench.read(min(LOOK_S, left_s) if left_s > 1e-9 else LOOK_S)
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
