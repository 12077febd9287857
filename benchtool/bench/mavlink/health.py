"""Fault detection of an autopilot from heartbeats, status texts and dropouts."""

from __future__ import annotations

import re
from typing import Literal

from benchtool.bench.mavlink.link import SILENCE_TIMEOUT_S
from benchtool.bench.mavlink.messages import Message
from benchtool.core.errors import LinkLost

# Heartbeats come every second; five missing ones, while streams continue, are a failed autopilot.
# Assumed: a link that loses every tenth frame misses five in a row once in a day.
HEARTBEAT_TIMEOUT_S = 5.5

ARMED_FLAG = 128  # bit of the heartbeat's base_mode (MAV_MODE_FLAG): motors armed
STALE_TIMEOUT_S = 1.0  # wall time without data after which the link is lost; assumed
MAX_CHUNK_LENGTH = 50  # of one STATUSTEXT; longer texts come in several with the same id
ARMING_S = 1.5  # from the first command to a heartbeat that shows armed, one per second
WARNING = 4  # MAV_SEVERITY: notices, information and debug texts end no run

RESTARTED = "the autopilot restarted"

TextKind = Literal["information", "failsafe", "refusal", "restart"]

_RESTART_TEXT = re.compile(r"^ArduPilot Ready$|^Motor Test: Board initialising$")
_FAILSAFE_TEXT = re.compile(
    r"failsafe|crash|thrust loss|yaw imbalance|disarm|kill|emergency|terminat", re.I
)
_HARMLESS_TEXT = re.compile(r"^(PreArm|Arm): |cleared", re.I)


def classify_status_text(text: str, severity: int) -> TextKind:
    """Return the effect of a status text of the autopilot on a run.

    Severity decides first: of texts below a warning only those of a restart count. Arming checks
    are repeated every 30 s and do not concern motor tests.
    """
    if _RESTART_TEXT.search(text):
        return "restart"
    if severity > WARNING or _HARMLESS_TEXT.search(text):
        return "information"
    if text.startswith("Motor Test: "):
        return "refusal"
    return "failsafe" if _FAILSAFE_TEXT.search(text) else "information"


class Health:
    """State of an autopilot from its heartbeats and status texts.

    Attributes:
        refusal: last text of warning or worse, until `drive` or the caller clears it.

    Args:
        arms: the heartbeat shows armed while motors are driven.
    """

    def __init__(self, arms: bool) -> None:
        self.armed = False
        self.texts: list[str] = []
        self.refusal = ""
        self._arms = arms
        self._heartbeat_s: float | None = None
        self._driven_since_s: float | None = None
        self._was_armed = False
        self._fault: str | None = None
        self._chunks: dict[tuple[int, int], list[str]] = {}

    @property
    def driven(self) -> bool:
        """Return whether motors are commanded above stop."""
        return self._driven_since_s is not None

    def drive(self, driven: bool, now_s: float) -> None:
        if not driven:
            self._driven_since_s, self._was_armed = None, False
        elif self._driven_since_s is None:
            self._driven_since_s = now_s
            self._fault = RESTARTED if self._fault == RESTARTED else None

    def process_heartbeat(self, message: Message, now_s: float, outputs_match: bool = True) -> None:
        """Process a heartbeat.

        Args:
            outputs_match: the outputs match the command. If not, the motor test has ended, for
                example by lost commands, and the check of the outputs reports the fault.
        """
        self._heartbeat_s = now_s
        self.armed = bool(message.base_mode & ARMED_FLAG)
        if self._driven_since_s is None or not self._arms or not outputs_match:
            return
        self._was_armed = self._was_armed or self.armed
        if not self.armed and self._was_armed:
            self._fault = "the autopilot disarmed"
        elif not self.armed and now_s - self._driven_since_s > ARMING_S:
            self._fault = "the autopilot stayed disarmed while a motor was commanded"

    def process_text(self, message: Message, is_own: bool = True) -> None:
        """Process a STATUSTEXT or a chunk of one; texts of other components end no run."""
        component = 0 if is_own else int(message.get_srcComponent())
        text = str(message.text)
        if number := int(message.id):
            chunks = self._chunks.setdefault((component, number), [])
            chunks.append(text)
            if len(text) >= MAX_CHUNK_LENGTH:
                return
            text = "".join(self._chunks.pop((component, number)))
        self.texts.append(text if is_own else f"component {component}: {text}")
        if not is_own:
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
        """Return and clear the fault that ends the run, or None."""
        fault, self._fault = self._fault, None
        return fault

    def silence_s(self, now_s: float) -> float:
        if self._heartbeat_s is None:
            self._heartbeat_s = now_s
        return now_s - self._heartbeat_s

    def skip(self, pause_s: float) -> None:
        """Exclude a pause of the reader from the timeouts."""
        if self._heartbeat_s is not None:
            self._heartbeat_s += pause_s
        if self._driven_since_s is not None:
            self._driven_since_s += pause_s


def find_silence_error(address: str, silent_s: float, since_heartbeat_s: float) -> LinkLost | None:
    """Return the error for silence of all messages, or of heartbeats; None if both are short."""
    if silent_s > STALE_TIMEOUT_S:
        return LinkLost(
            f"{address} sent nothing for {silent_s:.1f} s, limit {STALE_TIMEOUT_S:g} s; no motor "
            f"command was sent after {SILENCE_TIMEOUT_S:g} s of it, and motor tests expire; check "
            f"cable and power, then start again"
        )
    if since_heartbeat_s > HEARTBEAT_TIMEOUT_S:
        return LinkLost(
            f"{address} sends, but no heartbeat came for {since_heartbeat_s:.1f} s, limit "
            f"{HEARTBEAT_TIMEOUT_S:g} s; check the flight controller, then start again"
        )
    return None
