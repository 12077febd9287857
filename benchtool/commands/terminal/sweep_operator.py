"""Ask the operator something while the bench is listened to."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING

from benchtool.core.errors import InputError, RunStopped

if TYPE_CHECKING:
    from benchtool.bench.bench import Identity
    from benchtool.bench.guard import GuardedBench
    from benchtool.core.rig import Rig

LOOK_S = 0.05


def answer_to(question: str, meanwhile: Callable[[], object] | None = None) -> str:
    """Return what the operator types, `meanwhile` called again and again; refuse an ended input."""
    print(question, end="", flush=True)
    if meanwhile is None:
        return _line(sys.stdin.readline())
    typed: list[str] = []
    reader = threading.Thread(target=lambda: typed.append(sys.stdin.readline()), daemon=True)
    reader.start()
    while reader.is_alive():
        meanwhile()
        reader.join(LOOK_S)
    return _line(typed[0] if typed else "")


def say_of_bench(identity: Identity, rig: Rig) -> None:
    """Print what a person must know of a bench before arming it."""
    from benchtool.acquire.arming import arming_warnings

    for warning in arming_warnings(identity, rig):
        print(f"warning: {warning}")
    if identity.speed != 1.0:
        speed = f"{identity.speed:g} times the speed of life"
        print(f"this bench runs at {speed}; all times are the bench's own")


def say_of_end(bench: GuardedBench) -> None:
    """Print which rotors were not seen to stand at a normal end."""
    if (state := bench.standstill) is not None and not state.seen:
        print(f"warning: {state.text}")


def arm(text: str, bench: GuardedBench, rig: Rig, *, unattended: bool) -> None:
    """Show what will spin; a typed confirmation is needed unless the bench may run unattended.

    Raises:
        InputError: nobody is there to confirm, or the bench may not be left alone.
        RunStopped: something else was typed.
    """
    from datetime import datetime

    from benchtool.acquire.arming import require_unattended

    if not unattended:
        confirm_arming(text, bench)
        return
    require_unattended(bench.identity, rig, datetime.now().astimezone().date())
    print(text, flush=True)


def confirm_arming(text: str, bench: GuardedBench) -> None:
    """Show what will spin and ask for a typed confirmation.

    Raises:
        InputError: nobody is there to confirm.
        RunStopped: something else was typed.
    """
    from benchtool.acquire.arming import CONFIRMATION

    print(text)
    is_virtual = bench.identity.address.startswith("sim:")
    meanwhile = None if is_virtual else lambda: bench.read(LOOK_S)
    with bench.interruptible():
        answer = answer_to(f"type {CONFIRMATION} to arm: ", meanwhile)
    if answer.strip() != CONFIRMATION:
        raise RunStopped(f"not armed: {CONFIRMATION} was not typed; nothing was spun")


def _line(line: str) -> str:
    if not line:
        print()
        raise InputError(
            "nobody answered: the input has ended; run it in a terminal, or give --yes where the "
            "bench allows it"
        )
    return line.rstrip("\n")
