"""Operator interface, and arming: texts, and conditions for unattended runs."""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import asdict
from datetime import date
from hashlib import sha256
from typing import Any, Protocol

from benchtool.acquire.check_plan import PlanExtremes
from benchtool.acquire.plan import Plan
from benchtool.acquire.record import ProgressBar, ProgressLines, RunProgress
from benchtool.acquire.visit_order import (
    expected_duration_s,
    format_duration,
    plan_settings,
    plan_visits,
)
from benchtool.bench.bench import DeviceInfo
from benchtool.bench.limit_check import format_unmonitored_limits
from benchtool.bench.standstill import format_unmeasured_rotors
from benchtool.core.errors import InputError
from benchtool.core.rig import Rig
from benchtool.core.text import pluralize
from benchtool.data.run.state import load_state, store_state

CONFIRMATION = "ARM"  # typed by the operator
ARMING_QUESTION = f"type {CONFIRMATION} to arm: "
WARNING = "warning: "  # begin of a line that warns the operator
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


class Quiet(Unattended):
    """Operator of `bt.sweep` and `bt.record`: warnings, and a progress bar if requested."""

    def __init__(self, *, progress: bool) -> None:
        self._progress = progress
        self.last_line = ""

    def inform(self, text: str) -> None:
        self.last_line = text
        if text.startswith(WARNING):
            self.warn(text.removeprefix(WARNING))

    def warn(self, text: str) -> None:
        sys.stderr.write(f"{WARNING}{text}\n")  # each time, unlike `warnings.warn`

    @contextmanager
    def display(self, radius_m: float | None) -> Iterator[RunProgress]:
        if not self._progress:
            yield RunProgress()
            return
        try:
            yield ProgressBar()
        finally:
            sys.stderr.write("\n")


def plan_text(plan: Plan, rig: Rig, expected: PlanExtremes, done: Collection[int] = ()) -> str:
    """Return the description of a resolved plan without the visits that are done."""
    visits = plan_visits(plan, rig)
    remaining = [visit for visit in visits if visit.point not in done]
    counts = {
        kind: sum(visit.kind == kind for visit in remaining) for kind in ("reference", "anchor")
    }
    radius_m = rig.propulsion.radius_m
    distances = ", ".join(f"{z_m / radius_m:g}" for z_m in plan.plate.distances_m)
    where = (
        f"plate z/R {distances}; tilt {_list(plan.plate.tilts_deg)} deg; "
        f"lateral {_list(plan.plate.lateral_m)} m"
        if plan.plate.used
        else "no plate: parked if the bench moves one; else remove it, at least 4 radii away"
    )
    parts = (
        f", including {pluralize(counts['reference'], 'reference')} and "
        f"{pluralize(counts['anchor'], 'anchor')}"
        if plan.plate.used
        else ""
    )
    return (
        f"rig {rig.name}: {rig.title}\n"
        f"{where}\n"
        f"pulses {_list(plan.throttle.pwm_us)} us on rotors {_list(plan.throttle.rotors_on)}\n"
        f"{pluralize(len(plan_settings(plan, rig)), 'setting')}, "
        f"{pluralize(plan.repeats or 1, 'repeat')}, {plan.order.kind} with seed {plan.order.seed}: "
        f"{pluralize(len(remaining), 'visit')}{parts}\n"
        f"within limits: at most {expected.pwm_us:g} us, about {expected.rpm:.0f} rpm and "
        f"{expected.thrust_N:.1f} N of {rig.limits.thrust_N:g} N\n"
        f"expected duration {format_duration(expected_duration_s(plan, rig, remaining))}"
    )


def _list(numbers: tuple[float, ...]) -> str:
    return ", ".join(f"{number:g}" for number in numbers)


def arming_prompt(plan: Plan, rig: Rig, expected: PlanExtremes) -> str:
    """Return the prompt with rotors, pulses and expected thrust, shown before arming."""
    names = [f"{number} ({rig.rotors[number - 1].name})" for number in plan.throttle.rotors_on]
    in_ground_effect = f"near the plate {expected.thrust_N:.1f} N, " if plan.plate.used else ""
    return (
        f"rotors that will turn: {', '.join(names)}\n"
        f"highest pulse: {expected.pwm_us:g} us of {rig.limits.pwm_us:g} us, "
        f"about {expected.rpm:.0f} rpm\n"
        f"expected thrust: about {expected.thrust_oge_N:.1f} N, {in_ground_effect}"
        f"limit {rig.limits.thrust_N:g} N"
    )


def arming_warnings(identity: DeviceInfo, rig: Rig) -> tuple[str, ...]:
    """Return warnings about missing measurements and limits of a bench."""
    texts = (
        identity.facts.get("warning"),
        format_unmeasured_rotors(identity, rig),
        "" if identity.simulated else format_unmonitored_limits(identity.channels, rig.n_rotors),
    )
    return tuple(warning for warning in texts if warning)


def require_unattended(identity: DeviceInfo, rig: Rig, today: date) -> None:
    """Raise InputError unless a run without confirmation is allowed.

    Allowed are simulated benches, and benches whose `bench check` passed on the same day with the
    same rig, since limits of another rig were not checked.
    """
    if identity.simulated:
        return
    checked = load_state("checked", identity.device_id)
    if checked is not None and checked.get("device_id") != identity.device_id:
        checked = None
    if checked is not None and checked.get("date") == today.isoformat():
        if checked.get("rig_sha256") == _rig_hash(rig):
            return
        status = f"today's check used another or changed rig {checked['rig']!r}"
    else:
        status = (
            f"the last check passed on {checked['date']}" if checked else "it was never checked"
        )
    raise InputError(
        f"--yes needs a bench check of today on device {identity.device_id!r}, but {status}; run "
        f"benchtool bench check {identity.address}, or omit --yes and type the confirmation"
    )


def store_check_result(identity: DeviceInfo, rig: Rig, findings: list[str], today: date) -> None:
    """Store that a bench check passed today."""
    facts: dict[str, Any] = {
        "date": today.isoformat(),
        "device_id": identity.device_id,
        "rig": rig.name,
        "rig_sha256": _rig_hash(rig),
        "findings": findings,
    }
    store_state("checked", identity.device_id, facts)


def _rig_hash(rig: Rig) -> str:
    return sha256(repr(asdict(rig)).encode()).hexdigest()
