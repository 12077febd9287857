"""The board of a virtual G-code stage: real-time bytes, alarms, homing, moves, reports. Pure.

What it does with whole lines is `VirtualGrbl`'s.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Mapping

from benchtool.virtual.grbl_code import (
    ACCELERATION,
    AXES,
    FASTEST,
    CodeState,
    Reports,
    VirtualSettings,
)
from benchtool.virtual.grbl_motion import Homing, StageHardware, StageMotion

BANNER = "\r\nGrbl 1.1h ['$' for help]"

LOCKED = "[MSG:'$H'|'$X' to unlock]"

PULL_OFF_MM = 1.0

ALARM_S = 0.5
"""After an alarm it says nothing for so long, and throws a reset away after some."""

BOOT_S = 0.03
"""From a reset to the banner."""

PLANNER_BLOCKS, BUFFER_BYTES = 15, 128

INCHES = 13

HARD, SOFT, ABORTED, HOMING_ABORTED = 1, 2, 3, 6

NEED_RESET = (HARD, SOFT)


class GrblBoard(ABC):
    """Move axes X, Y and Z, whose machine positions go from minus their travel to 0.

    Attributes:
        position_mm: of each axis, as the board counts it.
        around: switches, buttons, lost steps.
        code: modes and offsets.
        startup: line of G-code that it obeys by itself after homing.

    Args:
        travel_mm: of each axis; that of the settings where left out.
        at_mm: where Z stands when the power comes on.
        settings: others than those of the stage that was recorded.
        around: switches as they are when the power comes on.
    """

    def __init__(
        self,
        travel_mm: Mapping[str, float] | None = None,
        at_mm: float = -PULL_OFF_MM,
        settings: Mapping[int, float] | None = None,
        hardware: StageHardware | None = None,
    ) -> None:
        travels = {130 + AXES.index(axis): mm for axis, mm in (travel_mm or {}).items()}
        self.settings = VirtualSettings(travels | dict(settings or {}))
        self.code = CodeState(self.settings)
        self.position_mm = dict.fromkeys(AXES, 0.0)
        # Where it stands when the power comes on is not known to the board.
        self.hardware = hardware or StageHardware()
        self.hardware.lost_mm = dict.fromkeys(AXES, -PULL_OFF_MM) | {"Z": at_mm}
        self.startup = ""
        self._now_s = 0.0
        self._locked = bool(self.settings[22])
        self._replies: list[str] = []
        self._start_anew()
        self._say_banner()

    def _start_anew(self) -> None:
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
        self._asked = False
        self._reports = Reports(self.settings)
        self.code.reset()

    def step(self, data: bytes, now_s: float) -> bytes:
        """Let time pass until `now_s`, take what arrived, and return what is said."""
        self._advance(now_s)
        for byte in data:
            self._take(byte)
            self._work()
        self._answer()
        said, self._replies = self._replies, []
        return "".join(f"{line}\r\n" for line in said).encode("ascii")

    @property
    def true_mm(self) -> dict[str, float]:
        """Where each axis really stands, with the steps that were lost."""
        return {axis: mm + self.hardware.lost_mm[axis] for axis, mm in self.position_mm.items()}

    @property
    def state(self) -> str:
        """Idle, Run, Jog, Hold:1 (slowing down), Hold:0, Home, Check, Sleep or Alarm."""
        if self._homing is not None:
            return "Home"
        if self._asleep:
            return "Sleep"
        if self._locked or self._alarm is not None:
            return "Alarm"
        if self._checking:
            return "Check"
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
        """Let all buttons go."""
        self.hardware.pressed.clear()

    def switch(self, axis: str, *, closed: bool) -> None:
        """Let a limit switch change; with hard limits on, either way is an alarm."""
        (self.hardware.closed.add if closed else self.hardware.closed.discard)(axis)
        if self.settings[21] and self._homing is None and self._alarm is None:
            self._stop_at_once()
            self._raise_alarm(HARD)

    def restart(self, boot_s: float = BOOT_S) -> None:
        """Start anew, as after a loss of power: the position is 0 and means nothing.

        Args:
            boot_s: until the banner; a boot loader takes nothing meanwhile.
        """
        self.hardware.lost_mm, self.position_mm = self.true_mm, dict.fromkeys(AXES, 0.0)
        self._locked = bool(self.settings[22])
        self._start_anew()
        self._boots_s, self._in_boot_loader = self._now_s + boot_s, boot_s > BOOT_S

    @property
    def _speed_mm_s(self) -> float:
        return self._moves[0].speed_mm_s if self._moves else 0.0

    def _take(self, byte: int) -> None:
        if self._in_boot_loader:
            return
        if byte in (0x18, 0x21, 0x3F, 0x7E) or byte >= 0x80:
            self._real_time(byte)
        elif len(self._received) < BUFFER_BYTES:
            # CR and LF end a line each.
            self._received += b"\n" if byte == 0x0D else bytes([byte])

    def _real_time(self, byte: int) -> None:
        if byte == 0x18:
            self._reset()
        elif byte == 0x3F:
            self._asked = True
        elif self._homing is not None or self._alarm is not None:
            return
        elif byte == 0x21:
            if self._jogging:
                self._cancel_jog()
            elif not (self._locked or self._checking or self._asleep):
                self._holding = True
        elif byte == 0x7E:
            if self.state == "Hold:0":
                self._holding = False
        elif byte == 0x85 and self._jogging:
            self._cancel_jog()
        elif 0x90 <= byte <= 0x94:
            change = {0x91: 10, 0x92: -10, 0x93: 1, 0x94: -1}
            present = self._reports.override
            self._reports.change_override(present + change[byte] if byte in change else 100)

    def _reset(self) -> None:
        if self._alarm is not None:
            number, until_s = self._alarm
            if number not in NEED_RESET or self._now_s < until_s:
                return
            self._alarm = None
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
        self._start_anew()
        self._boots_s = self._now_s + BOOT_S

    def _say_banner(self) -> None:
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

    def _cancel_jog(self) -> None:
        self._holding = bool(self._moves)

    def _advance(self, now_s: float) -> None:
        """Let time pass in pieces that end where something changes."""
        while self._now_s < now_s:
            ends = [self._boots_s, self._dwell_until_s, self._homing and self._homing.until_s]
            ends.append(self._alarm[1] if self._alarm else None)
            until_s = min([now_s, *(end for end in ends if end and end > self._now_s)])
            left_s = until_s - self._now_s
            while self._moves and left_s > 0.0:
                motion = self._moves[0]
                left_s = motion.advance(
                    left_s, 0.01 * self._reports.override, holding=self._holding
                )
                self.position_mm = motion.place_mm
                if not motion.done:
                    break
                self._moves.popleft()
            self._now_s = until_s
            self._work()
        self._now_s = max(now_s, self._now_s)
        self._work()

    def _work(self) -> None:
        """Do what has become due, then obey the lines that wait."""
        if self._boots_s is not None and self._now_s >= self._boots_s:
            self._say_banner()
        if self._alarm is not None:
            self._after_alarm(*self._alarm)
        if self._homing is not None and self._now_s >= self._homing.until_s:
            self._end_homing(self._homing)
        if self._jogging and (not self._moves or self.state == "Hold:0"):
            self._stop_at_once()
            self._holding = False
        if self._soft_pending and self._speed_mm_s == 0.0:
            self._soft_pending = self._holding = False
            self._stop_at_once()
            self._raise_alarm(SOFT)
        self._end_dwell()
        while not self._blocked and self._received:
            part, ended, self._received = self._received.partition(b"\n")
            self._line += part
            if ended:
                line, self._line = self._line, b""
                self._obey(line)

    @property
    def _blocked(self) -> bool:
        """Whether no line is looked at now."""
        return (
            self._boots_s is not None
            or self._alarm is not None
            or self._homing is not None
            or self._holding
            or self._asleep
            or self._open_line
        )

    def _after_alarm(self, number: int, until_s: float) -> None:
        if self._now_s < until_s or until_s == 0.0:
            return
        if number in NEED_RESET:
            self._replies.append("[MSG:Reset to continue]")
            self._alarm = (number, 0.0)
        else:
            self._alarm = None
            self._boot()

    def _end_dwell(self) -> None:
        if self._dwell_until_s is None or self._moves or self._holding or self._alarm is not None:
            return
        if self._dwell_until_s < 0.0:  # what comes before it has just ended
            self._dwell_until_s = self._now_s - self._dwell_until_s
        if self._now_s >= self._dwell_until_s - 1e-9:
            self._dwell_until_s, self._open_line = None, False
            self._replies.append("ok")

    def _end_homing(self, homing: Homing) -> None:
        self._homing = None
        self.position_mm = homing.place_mm
        if homing.alarm:
            self._raise_alarm(homing.alarm)
            return
        self.hardware.lost_mm = dict.fromkeys(AXES, 0.0)
        if self._asked:
            self._replies.append(self._report("Home"))
            self._asked = False
        self._locked = self._open_line = False
        self._say_startup()
        self._replies.append("ok")

    def _say_startup(self) -> None:
        if self.startup:
            self._replies.append(f">{self.startup}:ok")

    def _answer(self) -> None:
        """Answer a question for the state, where one is answered."""
        if self._asked and self._alarm is None and self._boots_s is None and self._homing is None:
            self._asked = False
            self._replies.append(self._report(self.state))

    @property
    def _end_mm(self) -> dict[str, float]:
        """Where it will stand when all that is queued is done."""
        return self._moves[-1].end_mm if self._moves else self.position_mm

    def _queue(self, target_mm: Mapping[str, float], feed_mm_min: float) -> None:
        settings = self.settings
        fastest = min(settings.of(FASTEST, axis) for axis in target_mm)
        accel = min(settings.of(ACCELERATION, axis) for axis in target_mm)
        motion = StageMotion(self._end_mm, target_mm, min(feed_mm_min, fastest) / 60.0, accel)
        if self._moves and self._moves[-1].goes_on(motion):
            return
        if not motion.done:
            self._moves.append(motion)

    def _report(self, state: str) -> str:
        return self._reports.text(
            state,
            self.position_mm,
            self.code.offset_mm,
            60.0 * self._speed_mm_s,
            (PLANNER_BLOCKS - len(self._moves), BUFFER_BYTES - len(self._received)),
            self.hardware.closed | self.hardware.stuck | self.hardware.pressed,
        )

    @abstractmethod
    def _obey(self, line: bytes) -> None:
        """Answer a whole line."""
