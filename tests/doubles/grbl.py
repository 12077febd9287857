"""Grbl 1.1h as a test double: what a stage driver sends is answered, on a clock handed in.

It follows conversations recorded from unmodified Grbl 1.1h. Offsets, arcs, probes and overrides are
not implemented.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import sqrt
from typing import Any

from benchtool.bench.drivers import GrblAddress
from benchtool.bench.stage.grbl import GrblStage
from benchtool.core.rig import PlateDrive
from benchtool.core.rig_file import load_rig_by_name
from benchtool.virtual.firmware import Firmware
from benchtool.virtual.links import ServerLink
from benchtool.virtual.server import ServedDevice

AXES = "XYZ"
SETTINGS: dict[int, float] = {
    0: 5, 1: 25, 2: 0, 3: 0, 4: 0, 5: 0, 6: 0, 10: 1, 11: 0.010, 12: 0.002, 13: 0, 20: 1, 21: 0,
    22: 1, 23: 0, 24: 300, 25: 3000, 26: 25, 27: 1, 30: 1000, 31: 0, 32: 0, 100: 100, 101: 100,
    102: 100, 110: 9000, 111: 9000, 112: 9000, 120: 500, 121: 500, 122: 500, 130: 20, 131: 20,
    132: 1500,
}  # fmt: skip
"""Of the stage whose conversations were recorded."""

STEPS, MAX_FEED, ACCELERATION, TRAVEL = 100, 110, 120, 130
WITH_DECIMALS = frozenset((11, 12, 24, 25, 27, *range(100, 140)))
MM_PER_INCH = 25.4
BANNER = "\r\nGrbl 1.1h ['$' for help]"
LOCKED = "[MSG:'$H'|'$X' to unlock]"
PULL_OFF_MM = 1.0
SEARCH = 1.5  # a switch is sought over so many times the travel
ALARM_S = 0.5  # silence after an alarm; a reset within it is discarded after some
BOOT_S = 0.03  # from a reset to the banner
MOTION_STEP_S = 0.002
BUFFER_BYTES = 128
HARD, SOFT, ABORTED, HOMING_ABORTED, STUCK, NO_SWITCH = 1, 2, 3, 6, 8, 9
NEED_RESET = (HARD, SOFT)
WCO_IDLE, WCO_BUSY, OV_IDLE, OV_BUSY = 10, 30, 10, 20  # reports between two with the field
WORD = re.compile(r"([A-Z])([-+]?(?:\d+\.?\d*|\.\d+))")
CODES = ("G0", "G1", "G4", "G20", "G21", "G53", "G90", "G91")


class Rejected(Exception):
    """Error number of a line that was rejected."""

    def __init__(self, number: int) -> None:
        self.number = number
        super().__init__(f"error:{number}")


def parse_words(text: str) -> tuple[set[str], dict[str, float]]:
    """Return the G-codes of a line, and its other words with their numbers."""
    codes: set[str] = set()
    words: dict[str, float] = {}
    at = 0
    while at < len(text):
        if not text[at].isalpha():
            raise Rejected(1)
        match = WORD.match(text, at)
        if match is None:
            raise Rejected(2)
        letter, number, at = match[1], float(match[2]), match.end()
        if letter == "G":
            if f"G{number:g}" not in CODES:
                raise Rejected(20)
            codes.add(f"G{number:g}")
        elif letter not in "FPXYZ":
            raise Rejected(20)
        elif letter in words:
            raise Rejected(25)
        else:
            words[letter] = number
    return codes, words


class StageMotion:
    """Motion of axes along one line, from standstill to standstill."""

    def __init__(
        self,
        start_mm: Mapping[str, float],
        target_mm: Mapping[str, float],
        feed_mm_s: float,
        accel_mm_s2: float,
    ) -> None:
        self.speed_mm_s = self._gone_mm = 0.0
        self._start_mm, self._target_mm = dict(start_mm), dict(target_mm)
        self._feed_mm_s, self._accel = feed_mm_s, accel_mm_s2
        self._length_mm = sqrt(sum((mm - start_mm[axis]) ** 2 for axis, mm in target_mm.items()))

    @property
    def end_mm(self) -> dict[str, float]:
        return self._start_mm | self._target_mm

    @property
    def done(self) -> bool:
        return self._gone_mm >= self._length_mm

    @property
    def position_mm(self) -> dict[str, float]:
        if self.done:
            return self.end_mm
        share = self._gone_mm / self._length_mm
        end_mm = self.end_mm
        return {axis: mm + share * (end_mm[axis] - mm) for axis, mm in self._start_mm.items()}

    def advance(self, left_s: float, *, holding: bool) -> float:
        """Move on for at most `left_s` and return the time that remains: s."""
        while left_s > 0.0 and not self.done and not (holding and self.speed_mm_s == 0.0):
            dt_s = min(left_s, MOTION_STEP_S)
            left_mm = self._length_mm - self._gone_mm
            # Never faster than the speed from which it can still stop.
            target_mm_s = 0.0 if holding else min(self._feed_mm_s, sqrt(2 * self._accel * left_mm))
            change, before = self._accel * dt_s, self.speed_mm_s
            self.speed_mm_s = min(max(target_mm_s, before - change), before + change)
            if self.speed_mm_s < 1e-9:
                self.speed_mm_s = 0.0
            step_mm = 0.5 * (before + self.speed_mm_s) * dt_s
            if step_mm >= left_mm - 1e-4 and not holding:
                self._gone_mm, self.speed_mm_s = self._length_mm, 0.0
                return left_s - dt_s
            self._gone_mm += min(step_mm, left_mm)
            left_s -= dt_s
        return left_s


@dataclass(slots=True)
class StageHardware:
    """Switches, buttons and lost steps.

    Attributes:
        closed: switches that are closed now.
        missing: switches that never close.
        stuck: switches that stay closed.
        pressed: buttons, as reports show them: H hold, S start, R abort.
        lost_mm: distance of each axis from where its steps were counted.
    """

    closed: set[str] = field(default_factory=set)
    missing: set[str] = field(default_factory=set)
    stuck: set[str] = field(default_factory=set)
    pressed: set[str] = field(default_factory=set)
    lost_mm: dict[str, float] = field(default_factory=lambda: dict.fromkeys(AXES, 0.0))


@dataclass(frozen=True, slots=True)
class Homing:
    """Homing under way: start, end, alarm at the end (0: none) and position at the end."""

    begun_s: float
    until_s: float
    alarm: int
    end_mm: dict[str, float]


class VirtualGrbl:
    """Stage with axes X, Y and Z, whose machine positions go from minus their travel to 0.

    Attributes:
        position_mm: position of each axis as the board counts it.
        offset_mm: work offset of each axis.
        startup: line of G-code that it runs by itself after homing.

    Args:
        travel_mm: travel of each axis; None means that of the recorded stage.
        at_mm: true position of Z at power-on.
        settings: settings that differ from those of the recorded stage.
    """

    def __init__(
        self,
        travel_mm: Mapping[str, float] | None = None,
        at_mm: float = -PULL_OFF_MM,
        settings: Mapping[int, float] | None = None,
        hardware: StageHardware | None = None,
    ) -> None:
        travels = {TRAVEL + AXES.index(axis): mm for axis, mm in (travel_mm or {}).items()}
        self.settings = SETTINGS | travels | dict(settings or {})
        self.position_mm = dict.fromkeys(AXES, 0.0)
        self.offset_mm = dict.fromkeys(AXES, 0.0)
        self.hardware = hardware or StageHardware()
        self.hardware.lost_mm = dict.fromkeys(AXES, -PULL_OFF_MM) | {"Z": at_mm}
        self.startup = ""
        self._now_s = 0.0
        self._locked = bool(self.settings[22])
        self._replies: list[str] = []
        self._forget()
        self._send_banner()

    def _forget(self) -> None:
        """Forget all that a reset forgets."""
        self._moves: deque[StageMotion] = deque()
        self._dwell_until_s: float | None = None
        self._homing: Homing | None = None
        self._holding = self._jogging = self._checking = self._asleep = False
        self._alarm: tuple[int, float] | None = None
        self._soft_pending = False
        self._boots_s: float | None = None
        self._received = self._line = b""
        self._open_line = False
        self._report_due = False
        self._wco = self._ov = 0
        self._modes, self._feed_mm_min = {"G0", "G21", "G90"}, 0.0

    def step(self, data: bytes, now_s: float) -> bytes:
        """Let time pass until `now_s`, take the bytes that arrived, and return the answers."""
        self._advance(now_s)
        for byte in data:
            if not self._in_boot_loader:
                if byte in (0x18, 0x21, 0x3F, 0x7E) or byte >= 0x80:
                    self._real_time(byte)
                elif len(self._received) < BUFFER_BYTES:
                    # CR and LF end a line each.
                    self._received += b"\n" if byte == 0x0D else bytes([byte])
            self._work()
        if self._report_due and not (self._alarm or self._boots_s or self._homing):
            self._report(self.state)
        replies, self._replies = self._replies, []
        return "".join(f"{line}\r\n" for line in replies).encode("ascii")

    @property
    def true_mm(self) -> dict[str, float]:
        """True position of each axis, with the steps that were lost."""
        return {axis: mm + self.hardware.lost_mm[axis] for axis, mm in self.position_mm.items()}

    @property
    def state(self) -> str:
        """Idle, Run, Jog, Hold:1 (slowing down), Hold:0, Home, Check, Sleep or Alarm."""
        for name, is_so in (
            ("Home", self._homing),
            ("Sleep", self._asleep),
            ("Alarm", self._locked or self._alarm),
            ("Check", self._checking),
        ):
            if is_so:
                return name
        if self._holding:
            return f"Hold:{int(self._speed_mm_s > 0.0)}"
        if self._moves:
            return "Jog" if self._jogging else "Run"
        return "Idle" if self._dwell_until_s is None else "Run"

    def press(self, button: str) -> None:
        """Press a button: H hold, S start, R abort; it stays pressed until `release`."""
        self.hardware.pressed.add(button)
        self._real_time({"H": 0x21, "S": 0x7E, "R": 0x18}[button])

    def release(self) -> None:
        """Release all buttons."""
        self.hardware.pressed.clear()

    def switch(self, axis: str, *, closed: bool) -> None:
        """Change a limit switch; with hard limits on, either way is an alarm."""
        (self.hardware.closed.add if closed else self.hardware.closed.discard)(axis)
        if self.settings[21] and self._homing is None and self._alarm is None:
            self._stop_at_once()
            self._raise_alarm(HARD)

    def restart(self, boot_s: float = BOOT_S) -> None:
        """Start anew after a loss of power; a boot loader takes nothing until the banner."""
        self.hardware.lost_mm, self.position_mm = self.true_mm, dict.fromkeys(AXES, 0.0)
        self._locked = bool(self.settings[22])
        self._forget()
        self._boots_s, self._in_boot_loader = self._now_s + boot_s, boot_s > BOOT_S

    @property
    def _speed_mm_s(self) -> float:
        return self._moves[0].speed_mm_s if self._moves else 0.0

    @property
    def _end_mm(self) -> dict[str, float]:
        """Position after all moves that are queued."""
        return self._moves[-1].end_mm if self._moves else self.position_mm

    def _real_time(self, byte: int) -> None:
        if byte == 0x18:
            self._reset()
        elif byte == 0x3F:
            self._report_due = True
        elif self._homing is not None or self._alarm is not None:
            return
        elif byte == 0x21 and self._jogging:
            self._holding = bool(self._moves)
        elif byte == 0x21:
            self._holding |= not (self._locked or self._checking or self._asleep)
        elif byte == 0x7E:
            self._holding &= self.state != "Hold:0"

    def _reset(self) -> None:
        if self._alarm is not None:
            number, until_s = self._alarm
            if number in NEED_RESET and self._now_s >= until_s:
                self._boot()
        elif self._homing is not None:
            gone_mm = (self._now_s - self._homing.begun_s) * self.settings[25] / 60.0
            self.position_mm["Z"] += min(gone_mm, -self.true_mm["Z"])
            self._homing = None
            self._raise_alarm(HOMING_ABORTED)
        elif self._speed_mm_s > 0.0:
            self._stop_at_once()
            self._raise_alarm(ABORTED)
        else:
            self._locked = self._locked or self._asleep
            self._boot()

    def _raise_alarm(self, number: int) -> None:
        self._locked = True
        self._replies.append(f"ALARM:{number}")
        self._alarm = (number, self._now_s + ALARM_S)

    def _boot(self) -> None:
        """Answer the line at work, if there is one, and start anew."""
        if self._open_line:
            self._replies.append("ok")
        self._forget()
        self._boots_s = self._now_s + BOOT_S

    def _send_banner(self) -> None:
        self._boots_s, self._in_boot_loader = None, False
        self._replies.append(BANNER)
        if self.settings[21] and self.hardware.closed:
            self._locked = True
            self._replies.append("[MSG:Check Limits]")
        if self._locked:
            self._replies.append(LOCKED)

    def _stop_at_once(self) -> None:
        self._moves.clear()
        self._jogging = False

    def _advance(self, now_s: float) -> None:
        """Let time pass in pieces that end where something changes."""
        while self._now_s < now_s:
            ends = [self._boots_s, self._dwell_until_s, self._homing and self._homing.until_s]
            ends.append(self._alarm[1] if self._alarm else None)
            until_s = min([now_s, *(end for end in ends if end and end > self._now_s)])
            left_s = until_s - self._now_s
            while self._moves and left_s > 0.0:
                motion = self._moves[0]
                left_s = motion.advance(left_s, holding=self._holding)
                self.position_mm = motion.position_mm
                if not motion.done:
                    break
                self._moves.popleft()
            self._now_s = until_s
            self._work()
        self._now_s = max(now_s, self._now_s)
        self._work()

    def _work(self) -> None:
        """Do what has become due, then run the lines that wait."""
        if self._boots_s is not None and self._now_s >= self._boots_s:
            self._send_banner()
        # An alarm that was reported to need a reset has the time 0 and waits.
        if self._alarm is not None and 0.0 < self._alarm[1] <= self._now_s:
            if self._alarm[0] in NEED_RESET:
                self._replies.append("[MSG:Reset to continue]")
                self._alarm = (self._alarm[0], 0.0)
            else:
                self._boot()
        if self._homing is not None and self._now_s >= self._homing.until_s:
            self._end_homing(self._homing)
        if self._jogging and (not self._moves or self.state == "Hold:0"):
            self._stop_at_once()
            self._holding = False
        if self._soft_pending and self._speed_mm_s == 0.0:
            self._soft_pending = self._holding = False
            self._stop_at_once()
            self._raise_alarm(SOFT)
        if self._dwell_until_s is not None and not (self._moves or self._holding or self._alarm):
            if self._dwell_until_s < 0.0:  # the moves before it have just ended
                self._dwell_until_s = self._now_s - self._dwell_until_s
            if self._now_s >= self._dwell_until_s - 1e-9:
                self._dwell_until_s, self._open_line = None, False
                self._replies.append("ok")
        while not self._blocked and self._received:
            part, ended, self._received = self._received.partition(b"\n")
            self._line += part
            if ended:
                line, self._line = self._line, b""
                self._obey(line)

    @property
    def _blocked(self) -> bool:
        """Whether no line is looked at now."""
        waits = self._boots_s or self._alarm or self._homing
        return bool(waits or self._holding or self._asleep or self._open_line)

    def _home(self) -> Homing:
        """Return the course of a homing: Z first, then X and Y together."""
        seek_mm_s, locate_mm_s = self.settings[25] / 60.0, self.settings[24] / 60.0
        pull_off_mm = self.settings[27]
        end_mm, until_s = dict(self.position_mm), self._now_s
        for axes in ("Z", "XY"):
            if missing := [axis for axis in axes if axis in self.hardware.missing]:
                search_mm = SEARCH * max(self._setting(TRAVEL, axis) for axis in axes)
                end_mm |= dict.fromkeys(missing, search_mm)
                return Homing(self._now_s, until_s + search_mm / seek_mm_s, NO_SWITCH, end_mm)
            way_mm = max(
                0.0 if axis in self.hardware.closed else -self.true_mm[axis] for axis in axes
            )
            until_s += way_mm / seek_mm_s + seek_mm_s / self._setting(ACCELERATION, axes[0])
            end_mm |= dict.fromkeys(axes, -pull_off_mm)
            if self.hardware.stuck.intersection(axes):
                return Homing(self._now_s, until_s, STUCK, end_mm)
            until_s += pull_off_mm / locate_mm_s + 10.0 * 1e-3 * self.settings[26]
        return Homing(self._now_s, until_s, 0, end_mm)

    def _end_homing(self, homing: Homing) -> None:
        self._homing = None
        self.position_mm = homing.end_mm
        if homing.alarm:
            self._raise_alarm(homing.alarm)
            return
        self.hardware.lost_mm = dict.fromkeys(AXES, 0.0)
        if self._report_due:
            self._report("Home")
        self._locked = self._open_line = False
        if self.startup:
            self._replies.append(f">{self.startup}:ok")
        self._replies.append("ok")

    def _setting(self, group: int, axis: str) -> float:
        return self.settings[group + AXES.index(axis)]

    def _on_a_step(self, axis: str, mm: float) -> float:
        return round(mm * self._setting(STEPS, axis)) / self._setting(STEPS, axis)

    def _lengths(self, axes_mm: Mapping[str, float]) -> str:
        scale, digits = (MM_PER_INCH, 4) if self.settings[13] else (1.0, 3)
        return ",".join(f"{axes_mm[axis] / scale + 0.0:.{digits}f}" for axis in AXES)

    def _report(self, state: str) -> None:
        self._report_due = False
        mask, feed = int(self.settings[10]), 60.0 * self._speed_mm_s
        axes_mm = {axis: self._on_a_step(axis, mm) for axis, mm in self.position_mm.items()}
        if not mask & 1:
            axes_mm = {axis: axes_mm[axis] - self.offset_mm[axis] for axis in AXES}
        parts = [state, f"{'MPos' if mask & 1 else 'WPos'}:{self._lengths(axes_mm)}"]
        if mask & 2:
            parts.append(f"Bf:{15 - len(self._moves)},{BUFFER_BYTES - len(self._received)}")
        parts.append(f"FS:{feed / MM_PER_INCH:.1f},0" if self.settings[13] else f"FS:{feed:.0f},0")
        hardware = self.hardware
        pins = hardware.closed | hardware.stuck | hardware.pressed
        if closed := "".join(pin for pin in "XYZRHS" if pin in pins):
            parts.append(f"Pn:{closed}")
        busy = state.partition(":")[0] in ("Home", "Run", "Hold", "Jog")
        if self._wco > 0:
            self._wco -= 1
        else:
            self._wco = (WCO_BUSY if busy else WCO_IDLE) - 1
            self._ov = self._ov or 1
            parts.append(f"WCO:{self._lengths(self.offset_mm)}")
        if self._ov > 0:
            self._ov -= 1
        else:
            self._ov = (OV_BUSY if busy else OV_IDLE) - 1
            parts.append("Ov:100,100,100")
        self._replies.append(f"<{'|'.join(parts)}>")

    def _obey(self, line: bytes) -> None:
        """Answer a whole line of G-code or a `$` command."""
        text = re.sub(r"\s", "", line.decode("ascii", "replace")).upper()
        try:
            if text.startswith("$"):
                self._command(text)
            elif text:
                if self._locked or self._jogging:
                    raise Rejected(9)
                self._g_code(*parse_words(text))
            if not self._open_line:
                self._replies.append("ok")
                if self._asleep:
                    self._replies.append("[MSG:Sleeping]")
        except Rejected as rejected:
            self._replies.append(f"error:{rejected.number}")

    def _command(self, text: str) -> None:
        state = self.state
        if text.startswith("$J="):
            if state not in ("Idle", "Jog"):
                raise Rejected(8)
            codes, words = parse_words(text[3:])
            if not words.get("F"):
                raise Rejected(22)
            self._jogging = True
            self._queue(self._target(codes, words), words["F"])
        elif text == "$X":
            if self._locked and state == "Alarm":
                self._replies.append("[MSG:Caution: Unlocked]")
                self._locked = False
        elif state not in ("Idle", "Alarm", "Check"):
            raise Rejected(8)
        elif text == "$C":
            self._replies.append("[MSG:Enabled]")
            self._checking = True
        elif text == "$H":
            if not self.settings[22]:
                raise Rejected(5)
            self._open_line = True
            self._homing = self._home()
        elif text == "$SLP":
            self._asleep = True
        elif text == "$$":
            self._replies += [
                f"${number}={value:.{3 * (number in WITH_DECIMALS)}f}"
                for number, value in sorted(self.settings.items())
            ]
        else:
            raise Rejected(3)

    def _target(self, codes: set[str], words: Mapping[str, float]) -> dict[str, float]:
        scale = MM_PER_INCH if "G20" in codes else 1.0
        target_mm = {}
        for axis in AXES:
            if axis in words:
                mm = scale * words[axis]
                if "G53" not in codes:
                    mm += (self._end_mm if "G91" in codes else self.offset_mm)[axis]
                target_mm[axis] = self._on_a_step(axis, mm)
        return target_mm

    def _queue(self, target_mm: Mapping[str, float], feed_mm_min: float) -> None:
        feed_mm_min = min(feed_mm_min, *(self._setting(MAX_FEED, axis) for axis in target_mm))
        accel = min(self._setting(ACCELERATION, axis) for axis in target_mm)
        motion = StageMotion(self._end_mm, target_mm, feed_mm_min / 60.0, accel)
        if not motion.done:
            self._moves.append(motion)

    def _g_code(self, codes: set[str], words: Mapping[str, float]) -> None:
        if "G4" in codes:
            if "P" not in words:
                raise Rejected(28)
            if not self._checking:
                # Below 0 until the moves before it have ended.
                self._dwell_until_s = -max(words["P"], 1e-9)
                self._open_line = True
            return
        for group in ({"G0", "G1"}, {"G20", "G21"}, {"G90", "G91"}):
            if len(codes & group) > 1:
                raise Rejected(21)
            if codes & group:
                self._modes = self._modes - group | codes & group
        feed_mm_min = words.get("F", self._feed_mm_min)
        if "G1" in self._modes and not feed_mm_min:
            raise Rejected(22)
        self._feed_mm_min = feed_mm_min
        target_mm = self._target(self._modes | codes, words)
        if not target_mm or self._checking:
            return
        outside = (not -self._setting(TRAVEL, axis) <= mm <= 0.0 for axis, mm in target_mm.items())
        if self.settings[20] and any(outside):
            self._open_line = self._soft_pending = self._holding = True
            self._work()
        else:
            self._queue(target_mm, float("inf") if "G0" in self._modes else feed_mm_min)


class CarriedPlate(ServedDevice):
    """Served device whose plate is carried by the Z axis of a stage on a link of its own.

    The home switch is at the far end: Z at 0 is the greatest distance.
    """

    def __init__(
        self, device: ServedDevice, firmware: Firmware, link: ServerLink, plate: PlateDrive
    ) -> None:
        super().__init__(firmware)
        self._device, self._link, self._plate = device, link, plate
        firmware.hello = replace(firmware.hello, moves_plate=False)
        travel_mm = dict.fromkeys(AXES, 1e3 * plate.z_max_m)
        self.stage = VirtualGrbl(travel_mm, 1e3 * (plate.z_park_m - plate.z_max_m))

    def receive(self, data: bytes, now_s: float) -> bytes:
        answer = self._device.receive(data, now_s)
        self.host_since_s = self._device.host_since_s
        return answer

    def report(self, kind: str, text: str) -> bytes:
        return self._device.report(kind, text)

    def tick(self, n: int, now_s: float) -> tuple[bytes, list[bytes]]:
        self._link.write(self.stage.step(self._link.read(), now_s * self.speed))
        z_m = self._plate.z_max_m + 1e-3 * self.stage.true_mm["Z"]
        self.firmware._plant.command_plate(z_m, 0.0, 0.0)
        return self._device.tick(n, now_s)


def stage_option(path: str, plate: PlateDrive) -> str:
    """Return the `--stage` of a host for the stage at a path."""
    return f"grbl:{path}?axis=Z&zero_mm={1e3 * plate.z_max_m:g}&direction=1"


def grbl_stage(link: Any, options: str = "zero_mm=1500", **drive: float) -> GrblStage:
    """Return the driver on a link, without backlash; `drive` replaces fields of the plate."""
    plate = replace(
        load_rig_by_name("pquad").plate,
        **{"backlash_m": 0.0, "z_min_m": 0.0, "speed_m_s": 0.1, **drive},
    )
    address = GrblAddress.parse(f"grbl:/dev/stage?{options}")
    stage = GrblStage(link, address, plate, clock=link.clock)
    stage._link.name = "the stage"
    return stage
