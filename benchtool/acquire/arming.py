"""Arming: what is about to spin, and who may go on without typing a confirmation."""

from __future__ import annotations

from dataclasses import asdict
from datetime import date
from hashlib import sha256
from typing import Any

from benchtool.acquire.check_plan import PlanExtremes
from benchtool.acquire.plan import Plan
from benchtool.bench.bench import DeviceInfo
from benchtool.bench.limit_check import unmonitored_limits
from benchtool.bench.standstill import unmeasured_rotors
from benchtool.core.errors import InputError
from benchtool.core.rig import Rig
from benchtool.data.run.state import recall_latest, store_state

CONFIRMATION = "ARM"  # what the operator types


def arming_prompt(plan: Plan, rig: Rig, expected: PlanExtremes) -> str:
    """Return what the operator must know before confirming."""
    names = [f"{number} ({rig.rotors[number - 1].name})" for number in plan.throttle.rotors_on]
    near = f"near the plate {expected.thrust_N:.1f} N, " if plan.plate.used else ""
    return (
        f"rotors that will turn: {', '.join(names)}\n"
        f"highest pulse: {expected.pwm_us:g} us of {rig.limits.pwm_us:g} us, "
        f"about {expected.rpm:.0f} rpm\n"
        f"expected thrust: about {expected.thrust_oge_N:.1f} N, {near}"
        f"limit {rig.limits.thrust_N:g} N"
    )


def arming_warnings(identity: DeviceInfo, rig: Rig) -> tuple[str, ...]:
    """Return what makes a bench more dangerous than others, a sentence each."""
    found = (
        identity.facts.get("warning"),
        unmeasured_rotors(identity, rig),
        "" if identity.simulated else unmonitored_limits(identity.channels, rig.n_rotors),
    )
    return tuple(warning for warning in found if warning)


def require_unattended(identity: DeviceInfo, rig: Rig, today: date) -> None:
    """Refuse to go on without a typed confirmation unless that is safe.

    Safe is a simulated bench, or a bench whose `bench check` passed on the same day with this very
    rig: limits of another one were not looked at.

    Raises:
        InputError: neither holds.
    """
    if identity.simulated:
        return
    checked = recall_latest("checked", identity.device_id)
    if checked is not None and checked.get("device_id") != identity.device_id:
        checked = None
    if checked is not None and checked.get("date") == today.isoformat():
        if checked.get("rig_sha256") == _rig_hash(rig):
            return
        when = f"today's was made with rig {checked['rig']!r}, which is not this one any more"
    else:
        when = f"its last check passed on {checked['date']}" if checked else "it was never checked"
    raise InputError(
        f"--yes needs a bench check of today on device {identity.device_id!r}, but {when}; run "
        f"benchtool bench check {identity.address}, or leave --yes out and type the confirmation"
    )


def store_check_result(identity: DeviceInfo, rig: Rig, findings: list[str], today: date) -> None:
    """Keep that a bench check passed today."""
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
