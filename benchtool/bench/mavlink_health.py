"""What ends a run by itself on an autopilot: silence, a reboot, disarming, failsafes. Pure."""

from __future__ import annotations

import re

from benchtool.bench.mavlink_dialect import Message
from benchtool.errors import LinkLost

HEARTBEAT_LOST_S = 3.0
"""Heartbeats come every second; three missing ones are a dead autopilot. A choice."""

STALE_S = 1.0
"""A link that brings nothing for so long is lost (wall time); a choice, as on other benches."""

ARMED = 128
HIL = 32
"""Bits of the heartbeat's base_mode (MAV_MODE_FLAG): motors live; hardware in the loop, where
"all motors / actuators are blocked": what the virtual autopilot shows."""

CHUNK = 50
"""Letters of one STATUSTEXT; a longer text comes in several with one number."""

ARMING_S = 1.5
"""So long after the first order the heartbeat may still show disarmed: it comes once a second."""

_STOPPING = re.compile(
    r"failsafe|crash|thrust loss|motor test|yaw imbalance|disarm|kill|emergency|terminat", re.I
)
"""Words with which ArduPilot and PX4 announce that motors stop or are about to."""

_HARMLESS = re.compile(r"^(PreArm|Arm):|failsafe cleared|test (starting|complete)", re.I)


class Health:
    """Judge an autopilot by its heartbeats and texts.

    Attributes:
        armed: as the last heartbeat says.
        texts: what it said since they were last taken, oldest first.

    Args:
        arms: whether the heartbeat shows armed while motors are driven.
    """

    def __init__(self, arms: bool) -> None:
        self.armed = False
        self.texts: list[str] = []
        self._arms = arms
        self._beat_s: float | None = None
        self._driven_since_s: float | None = None
        self._was_armed = False
        self._fault: str | None = None
        self._chunks: dict[int, list[str]] = {}

    def drive(self, driven: bool, now_s: float) -> None:
        """Note whether motors are commanded above stop."""
        if not driven:
            self._driven_since_s, self._was_armed = None, False
        elif self._driven_since_s is None:
            self._driven_since_s, self._fault = now_s, None

    def beat(self, message: Message, now_s: float) -> None:
        """Note a heartbeat."""
        self._beat_s = now_s
        self.armed = bool(message.base_mode & ARMED)
        if self._driven_since_s is None or not self._arms:
            return
        self._was_armed = self._was_armed or self.armed
        if not self.armed and self._was_armed:
            self._fault = "the autopilot disarmed"
        elif not self.armed and now_s - self._driven_since_s > ARMING_S:
            self._fault = "the autopilot stayed disarmed while a motor was commanded"

    def text(self, message: Message) -> None:
        """Note a STATUSTEXT; a failsafe while motors are driven ends the run."""
        text = _whole(message, self._chunks)
        if text is None:
            return
        self.texts.append(text)
        stops = _STOPPING.search(text) and not _HARMLESS.search(text)
        if stops and self._driven_since_s is not None:
            self._fault = text

    def rebooted(self) -> None:
        """Note that the autopilot's clock began anew."""
        self._fault = "the autopilot rebooted"

    def take_fault(self) -> str | None:
        """Return why motors stand still, once, or None."""
        fault, self._fault = self._fault, None
        return fault

    def silence_s(self, now_s: float) -> float:
        """Return for how long no heartbeat came."""
        if self._beat_s is None:
            self._beat_s = now_s
        return now_s - self._beat_s

    def skip(self, pause_s: float) -> None:
        """Leave out a pause in which nobody listened."""
        if self._beat_s is not None:
            self._beat_s += pause_s
        if self._driven_since_s is not None:
            self._driven_since_s += pause_s


def silence_of(address: str, silent_s: float, quiet_s: float) -> LinkLost | None:
    """Return the error that a silence is, None for one that is short enough.

    Args:
        address: for the message.
        silent_s: for so long nothing came at all.
        quiet_s: for so long no heartbeat came.
    """
    if silent_s > STALE_S:
        return LinkLost(
            f"{address} sent nothing for {silent_s:.1f} s, limit {STALE_S:g} s; motor tests end "
            f"by themselves; check cable and power, then start again"
        )
    if quiet_s > HEARTBEAT_LOST_S:
        return LinkLost(
            f"{address} sends, but no heartbeat came for {quiet_s:.1f} s, limit "
            f"{HEARTBEAT_LOST_S:g} s; check the flight controller, then start again"
        )
    return None


def _whole(message: Message, chunks: dict[int, list[str]]) -> str | None:
    """Return a text of up to 50 letters, or several of them joined, None until it is whole."""
    part, number = str(message.text), int(message.id)
    if not number:
        return part
    chunks.setdefault(number, []).append(part)
    return "".join(chunks.pop(number)) if len(part) < CHUNK else None
