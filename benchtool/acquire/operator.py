"""The person at a bench: what is said and asked before motors turn, and who may go on alone."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext, suppress
from datetime import datetime
from typing import Protocol

from benchtool.acquire.arming import CONFIRMATION, arming_warnings, require_unattended
from benchtool.acquire.record import ProgressLines, RunProgress
from benchtool.bench.bench import DeviceInfo
from benchtool.bench.guard import GuardedBench
from benchtool.core.errors import BenchtoolError, InputError, RunInterrupted
from benchtool.core.rig import Rig
from benchtool.data.run.run import Run

POLL_INTERVAL_S = 0.05  # a bench is read so often while an answer is waited for


class Operator(Protocol):
    """Say something to a person, get answers, show a run while it goes on."""

    def inform(self, text: str) -> None:
        """Show a line or several."""

    def warn(self, text: str) -> None:
        """Show what went wrong while a run was closed."""

    def answer(self, question: str, meanwhile: Callable[[], object] | None = None) -> str:
        """Return the answer to a question, `meanwhile` called again and again.

        Raises:
            InputError: nobody answers.
        """

    def display(self, radius_m: float | None) -> AbstractContextManager[RunProgress]:
        """Show a sweep on a rotor of this radius while it runs; None: without a plate."""


class Unattended:
    """Write lines to standard output; nobody is there to answer: notebooks and scripts."""

    def inform(self, text: str) -> None:
        sys.stdout.write(f"{text}\n")
        sys.stdout.flush()

    warn = inform

    def answer(self, question: str, meanwhile: Callable[[], object] | None = None) -> str:
        raise InputError(
            f"nobody is there to answer {question.strip()!r}; run the command in a terminal, or "
            f"give an operator that answers"
        )

    def display(self, radius_m: float | None) -> AbstractContextManager[RunProgress]:
        return nullcontext(ProgressLines(radius_m, self.inform))


def describe_bench(operator: Operator, identity: DeviceInfo, rig: Rig) -> None:
    """Say what a person must know of a bench before arming it."""
    for warning in arming_warnings(identity, rig):
        operator.inform(f"warning: {warning}")
    if identity.speed != 1.0:
        speed = f"{identity.speed:g} times the speed of life"
        operator.inform(f"this bench runs at {speed}; all times are the bench's own")


def describe_end(operator: Operator, bench: GuardedBench) -> None:
    """Say which rotors were not seen to stand at a normal end."""
    if (state := bench.standstill) is not None and not state.seen:
        operator.inform(f"warning: {state.text}")


def arm(operator: Operator, text: str, bench: GuardedBench, rig: Rig, *, unattended: bool) -> None:
    """Say what will spin; a typed confirmation is needed unless the bench may run unattended.

    Raises:
        InputError: nobody is there to confirm, or the bench may not be left alone.
        RunInterrupted: something else was typed.
    """
    if not unattended:
        confirm_arming(operator, text, bench)
        return
    require_unattended(bench.identity, rig, datetime.now().astimezone().date())
    operator.inform(text)


def confirm_arming(operator: Operator, text: str, bench: GuardedBench) -> None:
    """Say what will spin and have a confirmation typed.

    Raises:
        InputError: nobody is there to confirm.
        RunInterrupted: something else was typed.
    """
    operator.inform(text)
    is_virtual = bench.identity.address.startswith("sim:")
    meanwhile = None if is_virtual else lambda: bench.read(POLL_INTERVAL_S)
    with bench.interruptible():
        answer = operator.answer(f"type {CONFIRMATION} to arm: ", meanwhile)
    if answer.strip() != CONFIRMATION:
        raise RunInterrupted(f"not armed: {CONFIRMATION} was not typed; nothing was spun")


def close_stopped(operator: Operator, run: Run, advice: str = "") -> None:
    """Write the tables of a run that stopped and say where it is, or what prevents that.

    Args:
        advice: how to go on with a run that lacks points.
    """
    try:
        run.close()
        if advice and run.metadata["state"] == "ended":
            advice = (
                f"every visit is measured and stored, so nothing is left to resume; look at what "
                f"stopped it, then go on with: benchtool fit {run.path}"
            )
    except (BenchtoolError, OSError, MemoryError) as error:
        operator.warn(f"{run.path} was not closed: {error}")
        return
    with suppress(OSError):
        operator.inform("; ".join(filter(None, (f"what was recorded is in {run.path}", advice))))
