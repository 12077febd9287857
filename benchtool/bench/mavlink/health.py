"""What ends a run on an autopilot by itself: its heartbeats, its texts, its silence. Pure."""

from __future__ import annotations

import re
from typing import Literal

from benchtool.bench.mavlink.link import SILENCE_TIMEOUT_S
from benchtool.bench.mavlink.messages import Message
from benchtool.core.errors import LinkLost

HEARTBEAT_TIMEOUT_S = 5.5
"""Heartbeats come every second; five missing ones, beside streams that go on, are a dead autopilot.
A choice: of a link that loses every tenth frame five in a row are missing once in a day."""

ARMED = 128  # bit of the heartbeat's base_mode (MAV_MODE_FLAG): motors live
STALE_TIMEOUT_S = (
    1.0  # wall time without data after which a link is lost, as on other benches; assumed
)
CHUNK = 50  # letters of one STATUSTEXT; a longer text comes in several with one number
ARMING_S = 1.5  # from the first order to a heartbeat that shows armed; one comes per second
WARNING = 4  # MAV_SEVERITY: what comes as a notice, as information or for debugging ends nothing

RESTARTED = "the autopilot restarted"

TextKind = Literal["information", "failsafe", "refusal", "restart"]

_STARTING = re.compile(r"^ArduPilot Ready$|^Motor Test: Board initialising$")
_FAILSAFE = re.compile(
    r"failsafe|crash|thrust loss|yaw imbalance|disarm|kill|emergency|terminat", re.I
)
_PASSES = re.compile(r"^(PreArm|Arm): |cleared", re.I)


def classify_status_text(text: str, severity: int) -> TextKind:
    """Return what a text of the autopilot itself means for a run.

    Severity decides first: of what is less than a warning only the words of a start count. Arming
    checks are repeated every 30 s and say nothing about motor tests.
    """
    if _STARTING.search(text):
        return "restart"
    if severity > WARNING or _PASSES.search(text):
        return "information"
    if text.startswith("Motor Test: "):
        return "refusal"
    return "failsafe" if _FAILSAFE.search(text) else "information"


class Health:
    """Judge an autopilot by its heartbeats and texts.

    Attributes:
        refusal: its last text of warning or worse, until `drive` or the caller empties it.

    Args:
        arms: whether the heartbeat shows armed while motors are driven.
    """

    def __init__(self, arms: bool) -> None:
        self.armed = False
        self.texts: list[str] = []
        self.refusal = ""
        self._arms = arms
        self._beat_s: float | None = None
        self._driven_since_s: float | None = None
        self._was_armed = False
        self._fault: str | None = None
        self._chunks: dict[tuple[int, int], list[str]] = {}

    @property
    def driven(self) -> bool:
        """Whether motors are commanded above stop."""
        return self._driven_since_s is not None

    def drive(self, driven: bool, now_s: float) -> None:
        if not driven:
            self._driven_since_s, self._was_armed = None, False
        elif self._driven_since_s is None:
            self._driven_since_s = now_s
            self._fault = RESTARTED if self._fault == RESTARTED else None

    def beat(self, message: Message, now_s: float, shown: bool = True) -> None:
        """Note a heartbeat.

        Args:
            shown: whether the outputs show what was commanded. Where they do not, the motor test
                has ended, as when orders get lost; the outputs say what that means.
        """
        self._beat_s = now_s
        self.armed = bool(message.base_mode & ARMED)
        if self._driven_since_s is None or not self._arms or not shown:
            return
        self._was_armed = self._was_armed or self.armed
        if not self.armed and self._was_armed:
            self._fault = "the autopilot disarmed"
        elif not self.armed and now_s - self._driven_since_s > ARMING_S:
            self._fault = "the autopilot stayed disarmed while a motor was commanded"

    def text(self, message: Message, own: bool = True) -> None:
        """Note a STATUSTEXT or a piece of one; those of other components end nothing."""
        component = 0 if own else int(message.get_srcComponent())
        text = str(message.text)
        if number := int(message.id):
            whole = self._chunks.setdefault((component, number), [])
            whole.append(text)
            if len(text) >= CHUNK:
                return
            text = "".join(self._chunks.pop((component, number)))
        self.texts.append(text if own else f"component {component}: {text}")
        if not own:
            return
        kind = classify_status_text(text, message.severity)
        if message.severity <= WARNING:
            self.refusal = text
        if kind == "restart":
            self.restarted()
        elif kind != "information" and self.driven:
            self._fault = text

    def restarted(self) -> None:
        self._fault = RESTARTED

    def take_fault(self) -> str | None:
        """Return why the run ends, once, or None."""
        fault, self._fault = self._fault, None
        return fault

    def silence_s(self, now_s: float) -> float:
        if self._beat_s is None:
            self._beat_s = now_s
        return now_s - self._beat_s

    def skip(self, pause_s: float) -> None:
        """Leave out a pause in which nobody listened."""
        if self._beat_s is not None:
            self._beat_s += pause_s
        if self._driven_since_s is not None:
            self._driven_since_s += pause_s


def silence_message(address: str, silent_s: float, beatless_s: float) -> LinkLost | None:
    """Return the error for a silence of everything, or of heartbeats; None where both are short."""
    if silent_s > STALE_TIMEOUT_S:
        return LinkLost(
            f"{address} sent nothing for {silent_s:.1f} s, limit {STALE_TIMEOUT_S:g} s; no order "
            "to turn "
            f"was sent after {SILENCE_TIMEOUT_S:g} s of it, and motor tests end by themselves; "
            f"check cable and power, then start again"
        )
    if beatless_s > HEARTBEAT_TIMEOUT_S:
        return LinkLost(
            f"{address} sends, but no heartbeat came for {beatless_s:.1f} s, limit "
            f"{HEARTBEAT_TIMEOUT_S:g} s; check the flight controller, then start again"
        )
    return None
