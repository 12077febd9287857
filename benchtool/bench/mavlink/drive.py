"""Motor drives of an autopilot, fault detection, and the monitor that stops motors on a fault."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from contextlib import suppress
from typing import Literal

from benchtool.bench.mavlink import frames as mav
from benchtool.bench.mavlink.autopilots import AutopilotInfo
from benchtool.bench.mavlink.frames import Message
from benchtool.bench.mavlink.link import SILENCE_TIMEOUT_S, MavlinkLink
from benchtool.bench.mavlink.rows import MavlinkRows
from benchtool.core.choices import ArmedBy
from benchtool.core.errors import CommandRefused, DeviceStopped, HostSuspended, LinkLost

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
    """State of an autopilot from its heartbeats and status texts."""

    def __init__(self, arms: bool) -> None:
        self.armed = False
        self.texts: list[str] = []
        self.refusal = ""  # last text of warning or worse, until `drive` or the caller clears it
        self._arms = arms  # the heartbeat shows armed while motors are driven
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
        """Process a heartbeat."""
        self._heartbeat_s = now_s
        self.armed = bool(message.base_mode & ARMED_FLAG)
        # If the outputs do not match the command, the motor test has ended, for example by lost
        # commands, and the check of the outputs reports the fault.
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
            self._fault = RESTARTED
        elif kind != "information" and self.driven:
            self._fault = text

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


ARM_TIMEOUT_S = 3.0  # from accepted arming to a heartbeat that shows it, one per second

Outputs = tuple[float, ...]


class MotorDrive(ABC):
    """Interface that turns motors, keeps them turning while the bench is read, and stops them."""

    repeats_commands = False  # motor commands expire and are repeated

    def __init__(
        self, link: MavlinkLink, autopilot: AutopilotInfo, health: Health, arm: ArmedBy
    ) -> None:
        self._link, self._autopilot, self._health = link, autopilot, health
        self._arm, self._clock = arm, link.clock
        self._ended = False
        self.max_pulse_us = 0.0

    @abstractmethod
    def command(self, pulses_us: tuple[float, ...]) -> None:
        """Command the pulse width of every rotor: us."""

    @abstractmethod
    def stop(self) -> None:
        """Stop every motor immediately."""

    @abstractmethod
    def release(self) -> None:
        """Stop the motors that the host has started, before the link is closed."""

    def stop_renewing(self) -> None:  # noqa: B027 -- a loop on board has no commands to repeat
        """Send no further motor command; those that were sent expire."""

    def end(self) -> None:
        """Send no further command of any kind: the autopilot has restarted."""
        self.stop_renewing()
        self._ended = True

    def renew(self, now_s: float) -> str | None:
        """Repeat motor commands that expire; return the reason of a rejection, or None.

        Raises:
            HostSuspended: the last command has expired, so its motors have stopped.
        """
        return None

    def update_outputs(self, outputs_us: Outputs, now_s: float) -> tuple[int, int] | None:
        """Process reported outputs; return a rotor and its output if newly identified."""
        return None

    def outputs_match(self) -> bool:
        """Return whether the last reported outputs match the command."""
        return True

    def fault(self, outputs_us: Outputs, now_s: float) -> str | None:
        """Return why the outputs do not match the command, or None."""
        return None


class PitchDrive(MotorDrive):
    """Drive by the autopilot's control loop: arms it or waits for arming, and disarms it."""

    _driven = False

    def command(self, pulses_us: tuple[float, ...]) -> None:
        if sum(pulses_us) / len(pulses_us) <= self._autopilot.pulses.idle_us:
            if self._driven:
                self.stop()
            return
        if self._driven:
            return
        if not self._health.armed and self._arm == "host":
            self._health.refusal = ""
            result = self._link.exchange(mav.MavCommand(mav.ARM_DISARM, (1.0, *[0.0] * 6)))
            if result != mav.ACCEPTED:
                raise CommandRefused("arm", self._health.refusal or mav.result_name(result))
        deadline_s = self._clock() + ARM_TIMEOUT_S
        while not self._health.armed and self._clock() < deadline_s:
            self._link.pump(0.02)
        if not self._health.armed:
            raise CommandRefused(
                "record",
                "it is not armed; arm it with its transmitter first, or set arm=host in the "
                "address",
            )
        self._driven, self.max_pulse_us = True, max(pulses_us)
        self._health.drive(True, self._clock())

    def stop(self) -> None:
        self._driven, self.max_pulse_us = False, 0.0
        self._health.drive(False, self._clock())
        if not self._ended:
            self._link.exchange(mav.MavCommand(mav.ARM_DISARM, (0.0, mav.FORCE_DISARM, *[0.0] * 5)))

    def release(self) -> None:
        # A vehicle that the host has not started is not disarmed.
        if self._driven:
            self.stop()


COMMAND_INTERVAL_S = 0.15  # a longer interval between reads is a pause of the host


class RunMonitor:
    """Monitor of a run: reads, repeats commands, and stops the motors on a fault."""

    def __init__(
        self, link: MavlinkLink, health: Health, drive: MotorDrive, rows: MavlinkRows
    ) -> None:
        # Commands to a restarted autopilot, which request its outputs, because only they show
        # standstill
        self.restart_commands: list[mav.MavCommand] = []
        self._link, self._health, self._drive, self._rows = link, health, drive, rows
        self._pumped_s = link.clock()
        self._stopped: str | None = None
        self._is_reported = False
        link.take_gap()

    def pump(self, timeout_s: float) -> None:
        """Process received bytes, repeat expiring commands, and check for faults.

        Raises:
            LinkLost: the autopilot is silent.
            HostSuspended: no call for so long that the motors have stopped; zero was commanded.
        """
        pause_s = self._link.clock() - self._pumped_s
        if pause_s > COMMAND_INTERVAL_S:
            self._health.skip(pause_s)
            self._link.received_s += pause_s
        self._link.pump(timeout_s)
        self._pumped_s = now_s = self._link.clock()
        silent_s = now_s - self._link.received_s
        if silent_s > SILENCE_TIMEOUT_S:
            self._drive.stop_renewing()
        beat_s = self._health.silence_s(now_s)
        if silent_s > STALE_TIMEOUT_S:
            raise LinkLost(
                f"{self._link.address} sent nothing for {silent_s:.1f} s, limit "
                f"{STALE_TIMEOUT_S:g} s; no motor command was sent after {SILENCE_TIMEOUT_S:g} s "
                f"of it, and motor tests expire; check cable and power, then start again"
            )
        if beat_s > HEARTBEAT_TIMEOUT_S:
            raise LinkLost(
                f"{self._link.address} sends, but no heartbeat came for {beat_s:.1f} s, limit "
                f"{HEARTBEAT_TIMEOUT_S:g} s; check the flight controller, then start again"
            )
        text_fault = self._health.take_fault()
        fault = self._find_restart() or text_fault
        try:
            fault = fault or self._drive.renew(now_s)
        except HostSuspended:
            self._stop_motors()
            raise
        if silent_s <= SILENCE_TIMEOUT_S:
            fault = fault or self._drive.fault(self._rows.outputs_us, now_s)
        if fault is not None and self._stopped is None:
            self._stopped = fault
            if fault == RESTARTED:
                self._drive.end()
                for command in self.restart_commands:
                    self._link.send_command(command)
            self._stop_motors()

    def raise_if_stopped(self, repeat: bool = True) -> None:
        """Raise the fault that ended the run; with `repeat` False only once."""
        if self._stopped is None or (self._is_reported and not repeat):
            return
        self._is_reported = True
        raise DeviceStopped(
            f"the run was ended: {self._stopped}; zero was commanded; remove the cause and start "
            f"again"
        )

    def _find_restart(self) -> str | None:
        """Return the fault after a silence while motors turned, or after a restart."""
        gap = self._link.take_gap()
        if self._rows.time.rebooted or (gap and gap.from_start and self._health.driven):
            self._rows.time.rebooted = False
            return RESTARTED
        if gap and self._health.driven and self._drive.repeats_commands:
            return (
                f"the autopilot sent nothing for {gap.silent_s:.1f} s while a motor turned, "
                f"limit {SILENCE_TIMEOUT_S:g} s"
            )
        return None

    def _stop_motors(self) -> None:
        with suppress(LinkLost):  # motor commands expire
            self._drive.stop()
