"""Arming of motors: prompt, warnings, and conditions for unattended runs."""

from __future__ import annotations

from dataclasses import asdict
from datetime import date
from hashlib import sha256
from typing import Any

from benchtool.acquire.check_plan import PlanExtremes
from benchtool.acquire.plan import Plan
from benchtool.bench.bench import DeviceInfo
from benchtool.bench.limit_check import format_unmonitored_limits
from benchtool.bench.standstill import format_unmeasured_rotors
from benchtool.core.errors import InputError
from benchtool.core.rig import Rig
from benchtool.data.run.state import load_state, store_state

CONFIRMATION = "ARM"  # typed by the operator


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
