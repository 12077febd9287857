"""A virtual G-code stage: what Grbl 1.1h answers, and what it does not, on a clock handed in. Pure.

After conversations recorded from unmodified Grbl 1.1h. Times of homing and of restarts are near
those of the recordings; arcs, probes, spindles and doors are not there.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

from benchtool.virtual import grbl_code, grbl_motion

BANNER = "\r\nGrbl 1.1h ['$' for help]"
LOCKED = "[MSG:'$H'|'$X' to unlock]"
HELP = "[HLP:$$ $# $G $I $N $x=val $Nx=line $J=line $SLP $C $X $H ~ ! ? ctrl-x]"

PULL_OFF_MM = 1.0

ALARM_S = 0.5
"""After an alarm it sends nothing for so long, and discards a reset after some."""

BOOT_S = 0.03
"""From a reset to the banner."""

BUFFER_BYTES, INCHES = 128, 13

HARD, SOFT, ABORTED, HOMING_ABORTED = 1, 2, 3, 6

NEED_RESET = (HARD, SOFT)


class VirtualGrbl:
    """Move axes X, Y and Z, whose machine positions go from minus their travel to 0.

    Attributes:
        position_mm: of each axis, as the board counts it.
        startup: line of G-code that it obeys by itself after homing.

    Args:
        travel_mm: of each axis; that of the settings where left out.
        at_mm: where Z stands when the power comes on.
        settings: others than those of the stage that was recorded.
        hardware: switches, buttons and lost steps when the power comes on.
    """

    def __init__(
        self,
        travel_mm: Mapping[str, float] | None = None,
        at_mm: float = -PULL_OFF_MM,
        settings: Mapping[int, float] | None = None,
        hardware: grbl_motion.StageHardware | None = None,
    ) -> None:
        travels = {130 + grbl_code.AXES.index(axis): mm for axis, mm in (travel_mm or {}).items()}
        self.settings = grbl_code.VirtualSettings(travels | dict(settings or {}))
        self.code = grbl_code.CodeState(self.settings)
        self.position_mm = dict.fromkeys(grbl_code.AXES, 0.0)
        # Where it stands when the power comes on is not known to the board.
        self.hardware = hardware or grbl_motion.StageHardware()
        self.hardware.lost_mm = dict.fromkeys(grbl_code.AXES, -PULL_OFF_MM) | {"Z": at_mm}
        self.startup = ""
        self._now_s = 0.0
        self._locked = bool(self.settings[22])
        self._replies: list[str] = []
        self._forget()
        self._send_banner()

    def _forget(self) -> None:
        """Forget all that a reset forgets."""
        self._moves: deque[grbl_motion.StageMotion] = deque()
        self._dwell_until_s: float | None = None
        self._homing: grbl_motion.Homing | None = None
        self._holding = self._jogging = self._checking = self._asleep = False
        self._alarm: tuple[int, float] | None = None
        self._soft_pending = False
        self._boots_s: float | None = None
        self._received = self._line = b""
        self._open_line = False
        self._report_due = False
        self._reports = grbl_code.Reports(self.settings)
        self.code.reset()

    def step(self, data: bytes, now_s: float) -> bytes:
        """Let time pass until `now_s`, take what arrived, and return the answers."""
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
        """Where each axis really stands, with the steps that were lost."""
        return {axis: mm + self.hardware.lost_mm[axis] for axis, mm in self.position_mm.items()}

    @property
    def state(self) -> str:
        """Idle, Run, Jog, Hold:1 (slowing down), Hold:0, Home, Check, Sleep or Alarm."""
        for name, holds in (
            ("Home", self._homing),
            ("Sleep", self._asleep),
            ("Alarm", self._locked or self._alarm),
            ("Check", self._checking),
        ):
            if holds:
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
        """Let all buttons go."""
        self.hardware.pressed.clear()

    def switch(self, axis: str, *, closed: bool) -> None:
        """Let a limit switch change; with hard limits on, either way is an alarm."""
        (self.hardware.closed.add if closed else self.hardware.closed.discard)(axis)
        if self.settings[21] and self._homing is None and self._alarm is None:
            self._stop_at_once()
            self._raise_alarm(HARD)

    def restart(self, boot_s: float = BOOT_S) -> None:
        """Start anew after a loss of power; a boot loader takes nothing until the banner."""
        self.hardware.lost_mm, self.position_mm = self.true_mm, dict.fromkeys(grbl_code.AXES, 0.0)
        self._locked = bool(self.settings[22])
        self._forget()
        self._boots_s, self._in_boot_loader = self._now_s + boot_s, boot_s > BOOT_S

    @property
    def _speed_mm_s(self) -> float:
        return self._moves[0].speed_mm_s if self._moves else 0.0

    @property
    def _end_mm(self) -> dict[str, float]:
        """Where it will stand when all that is queued is done."""
        return self._moves[-1].end_mm if self._moves else self.position_mm

    def _real_time(self, byte: int) -> None:
        if byte == 0x18:
            self._reset()
        elif byte == 0x3F:
            self._report_due = True
        elif self._homing is not None or self._alarm is not None:
            return
        elif byte in (0x21, 0x85) and self._jogging:
            self._holding = bool(self._moves)
        elif byte == 0x21:
            self._holding |= not (self._locked or self._checking or self._asleep)
        elif byte == 0x7E:
            self._holding &= self.state != "Hold:0"
        elif 0x90 <= byte <= 0x94:
            change = {0x91: 10, 0x92: -10, 0x93: 1, 0x94: -1}.get(byte)
            self._reports.change_override(change)

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
            override = 0.01 * self._reports.override
            grbl_motion.run_moves(
                self._moves, self.position_mm, left_s, override, holding=self._holding
            )
            self._now_s = until_s
            self._work()
        self._now_s = max(now_s, self._now_s)
        self._work()

    def _work(self) -> None:
        """Do what has become due, then obey the lines that wait."""
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
            if self._dwell_until_s < 0.0:  # what comes before it has just ended
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

    def _end_homing(self, done: grbl_motion.Homing) -> None:
        self._homing = None
        self.position_mm = done.place_mm
        if done.alarm:
            self._raise_alarm(done.alarm)
            return
        self.hardware.lost_mm = dict.fromkeys(grbl_code.AXES, 0.0)
        if self._report_due:
            self._report("Home")
        self._locked = self._open_line = False
        if self.startup:
            self._replies.append(f">{self.startup}:ok")
        self._replies.append("ok")

    def _report(self, state: str) -> None:
        self._report_due = False
        text = self._reports.text(
            state,
            self.position_mm,
            self.code.offset_mm,
            60.0 * self._speed_mm_s,
            (15 - len(self._moves), BUFFER_BYTES - len(self._received)),
            self.hardware.closed | self.hardware.stuck | self.hardware.pressed,
        )
        self._replies.append(text)

    def _obey(self, line: bytes) -> None:
        """Answer a whole line of G-code or a `$` command."""
        try:
            text = grbl_code.cleaned(line)
            if text.startswith("$"):
                self._command(text)
            elif text:
                if self._locked or self._jogging:
                    raise grbl_code.Refused(9)
                self._g_code(grbl_code.block_of(text))
            if not self._open_line:
                self._replies.append("ok")
                if self._asleep:
                    self._replies.append("[MSG:Sleeping]")
        except grbl_code.Refused as refused:
            self._replies.append(f"error:{refused.number}")

    def _command(self, text: str) -> None:
        state = self.state
        if text.startswith("$J"):
            if state not in ("Idle", "Jog"):
                raise grbl_code.Refused(8)
            if not text.startswith("$J="):
                raise grbl_code.Refused(3)
            move = self.code.jog(grbl_code.block_of(text[3:]), self._end_mm)
            if self.settings.is_beyond(move[0]):
                raise grbl_code.Refused(15)
            self._jogging = True
            grbl_motion.queue_move(self._moves, self._end_mm, *move, self.settings)
        elif text == "$X":
            if self._locked and state == "Alarm":
                self._replies.append("[MSG:Caution: Unlocked]")
                self._locked = False
        elif text == "$G":
            self._replies.append(self.code.modes())
        elif text == "$C" and state == "Check":
            self._replies.append("[MSG:Disabled]")
            self._forget()
            self._boots_s = self._now_s + BOOT_S
        elif text == "$C":
            if state != "Idle":
                raise grbl_code.Refused(8)
            self._replies.append("[MSG:Enabled]")
            self._checking = True
        elif text == "$":
            self._replies.append(HELP)
        elif state not in ("Idle", "Alarm", "Check"):
            raise grbl_code.Refused(8)
        elif text == "$H":
            if not self.settings[22]:
                raise grbl_code.Refused(5)
            self._open_line = True
            self._homing = grbl_motion.homing(
                self.settings, self.position_mm, self.hardware, self._now_s
            )
        elif text == "$SLP":
            self._asleep = True
        elif text == "$$":
            self._replies += self.settings.lines()
        elif text == "$#":
            self._replies += self.code.lines()
        elif text == "$I":
            self._replies += ["[VER:1.1h.20190830:]", "[OPT:V,15,128]"]
        elif text.startswith("$I="):
            pass  # the build's own note
        elif text.startswith("$N0="):
            grbl_code.block_of(text[4:])
            self.startup = text[4:]
        elif text.startswith("$N"):
            if "=" not in text:
                self._replies += [f"$N0={self.startup}", "$N1="]
        elif self.settings.change(text) == INCHES:
            self._reports.show_offset()

    def _g_code(self, block: grbl_code.CodeBlock) -> None:
        if block.codes.get("once") == "G4":
            if "P" not in block.words:
                raise grbl_code.Refused(28)
            if not self._checking:
                # Below 0 until what comes before it has ended.
                self._dwell_until_s = -max(block.words["P"], 1e-9)
                self._open_line = True
            return
        offset_mm = self.code.offset_mm
        move = self.code.move(block, self._end_mm)
        if self.code.offset_mm != offset_mm:
            self._reports.show_offset()
        if move is None or self._checking:
            return
        if self.settings.is_beyond(move[0]):
            self._open_line = self._soft_pending = self._holding = True
            self._work()
        else:
            grbl_motion.queue_move(self._moves, self._end_mm, *move, self.settings)
