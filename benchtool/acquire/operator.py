"""Operator interface: messages, questions and confirmation before motors turn."""

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

ARMING_QUESTION = f"type {CONFIRMATION} to arm: "
POLL_INTERVAL_S = 0.05  # reads of the bench while waiting for an answer


class Operator(Protocol):
    """Operator interface: messages, answers, display of a run."""

    def inform(self, text: str) -> None:
        """Show one or more lines."""

    def warn(self, text: str) -> None:
        """Show a warning."""

    def answer(self, question: str, meanwhile: Callable[[], object] | None = None) -> str:
        """Return the answer to a question; call `meanwhile` repeatedly while waiting.

        Raises:
            InputError: no terminal to answer.
        """

    def display(self, radius_m: float | None) -> AbstractContextManager[RunProgress]:
        """Return the display of a sweep, for a rotor radius; None: without a plate."""


class Unattended:
    """Operator of notebooks and scripts: lines on standard output, no answers."""

    def inform(self, text: str) -> None:
        sys.stdout.write(f"{text}\n")
        sys.stdout.flush()

    warn = inform

    def answer(self, question: str, meanwhile: Callable[[], object] | None = None) -> str:
        raise InputError(
            f"confirmation {question.strip()!r} needs a terminal; run the command in a terminal or "
            f"pass operator="
        )

    def display(self, radius_m: float | None) -> AbstractContextManager[RunProgress]:
        return nullcontext(ProgressLines(radius_m, self.inform))


def describe_bench(operator: Operator, identity: DeviceInfo, rig: Rig) -> None:
    """Show the warnings of a bench before arming."""
    for warning in arming_warnings(identity, rig):
        operator.inform(f"warning: {warning}")
    if identity.speed != 1.0:
        operator.inform(f"bench at {identity.speed:g} times real time; all times are bench time")


def describe_end(operator: Operator, bench: GuardedBench) -> None:
    """Show rotors without confirmed standstill at a normal end."""
    if (state := bench.standstill) is not None and not state.is_confirmed:
        operator.inform(f"warning: {state.text}")


def arm(operator: Operator, text: str, bench: GuardedBench, rig: Rig, *, unattended: bool) -> None:
    """Ask for confirmation before motors spin; skip it for an unattended bench.

    Raises:
        InputError: no terminal to confirm, or the bench may not run unattended.
        RunInterrupted: not confirmed.
    """
    if not unattended:
        confirm_arming(operator, text, bench)
        return
    require_unattended(bench.identity, rig, datetime.now().astimezone().date())
    operator.inform(text)


def confirm_arming(operator: Operator, text: str, bench: GuardedBench) -> None:
    """Ask for a typed confirmation before motors spin.

    Raises:
        InputError: no terminal to confirm.
        RunInterrupted: not confirmed.
    """
    operator.inform(text)
    is_virtual = bench.identity.address.startswith("sim:")
    meanwhile = None if is_virtual else lambda: bench.read(POLL_INTERVAL_S)
    with bench.interruptible():
        answer = operator.answer(ARMING_QUESTION, meanwhile)
    if answer.strip() != CONFIRMATION:
        raise RunInterrupted(f"not armed: {CONFIRMATION} was not typed; no motor was started")


def close_stopped(operator: Operator, run: Run, advice: str = "") -> None:
    """Write the tables of a stopped run and show its path, or the error.

    Args:
        advice: next step for an incomplete run.
    """
    try:
        run.close()
        if advice and run.metadata["state"] == "ended":
            advice = (
                f"every visit is measured and stored; check the reason of the stop, then continue "
                f"with: benchtool fit {run.path}"
            )
    except (BenchtoolError, OSError, MemoryError) as error:
        operator.warn(f"{run.path} was not closed: {error}")
        return
    with suppress(OSError):
        operator.inform("; ".join(filter(None, (f"recorded data are in {run.path}", advice))))
