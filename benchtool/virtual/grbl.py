"""A virtual G-code stage: what Grbl 1.1h answers, and what it does not, on a clock handed in. Pure.

After conversations recorded from unmodified Grbl 1.1h. Times of homing and of restarts are near
those of the recordings; arcs, probes, spindles and doors are not there.
"""

from __future__ import annotations

from dataclasses import replace

from benchtool.core.rig import PlateDrive
from benchtool.virtual.firmware import Firmware
from benchtool.virtual.grbl_board import BOOT_S, INCHES, GrblBoard
from benchtool.virtual.grbl_code import CodeBlock, Refused, block_of, cleaned
from benchtool.virtual.grbl_motion import homing
from benchtool.virtual.links import ServerLink
from benchtool.virtual.server import ServedDevice

HELP = "[HLP:$$ $# $G $I $N $x=val $Nx=line $J=line $SLP $C $X $H ~ ! ? ctrl-x]"


class VirtualGrbl(GrblBoard):
    """Be a stage: obey lines of G-code and `$` commands on a board."""

    def _obey(self, line: bytes) -> None:
        try:
            text = cleaned(line)
            if text.startswith("$"):
                self._command(text)
            elif text:
                if self._locked or self._jogging:
                    raise Refused(9)
                self._g_code(block_of(text))
            if not self._open_line:
                self._replies.append("ok")
                if self._asleep:
                    self._replies.append("[MSG:Sleeping]")
        except Refused as refused:
            self._replies.append(f"error:{refused.number}")

    def _command(self, text: str) -> None:
        state = self.state
        if text.startswith("$J"):
            if state not in ("Idle", "Jog"):
                raise Refused(8)
            self._jog(text)
        elif text == "$X":
            if self._locked and state == "Alarm":
                self._replies.append("[MSG:Caution: Unlocked]")
                self._locked = False
        elif text == "$G":
            self._replies.append(self.code.modes())
        elif text == "$C":
            self._check_mode(state)
        elif text == "$":
            self._replies.append(HELP)
        elif state not in ("Idle", "Alarm", "Check"):
            raise Refused(8)
        elif text == "$H":
            if not self.settings[22]:
                raise Refused(5)
            self._open_line = True
            self._homing = homing(self.settings, self.position_mm, self.hardware, self._now_s)
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
        elif text.startswith("$N"):
            self._startup_line(text)
        else:
            if self.settings.change(text) == INCHES:
                self._reports.show_offset()

    def _check_mode(self, state: str) -> None:
        if state == "Check":
            self._replies.append("[MSG:Disabled]")
            self._start_anew()
            self._boots_s = self._now_s + BOOT_S
            return
        if state != "Idle":
            raise Refused(8)
        self._replies.append("[MSG:Enabled]")
        self._checking = True

    def _startup_line(self, text: str) -> None:
        name, equals, line = text.partition("=")
        if not equals:
            self._replies += [f"$N0={self.startup}", "$N1="]
        elif name == "$N0":
            block_of(line)
            self.startup = line

    def _jog(self, text: str) -> None:
        if not text.startswith("$J="):
            raise Refused(3)
        target_mm, feed_mm_min = self.code.jog(block_of(text[3:]), self._end_mm)
        if self.settings.is_beyond(target_mm):
            raise Refused(15)
        self._jogging = True
        self._queue(target_mm, feed_mm_min)

    def _g_code(self, block: CodeBlock) -> None:
        if block.codes.get("once") == "G4":
            if "P" not in block.words:
                raise Refused(28)
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
            self._queue(*move)


class CarriedPlate:
    """Be another served device, its plate carried by the Z axis of a stage on a link of its own.

    The home switch is at the far end: Z at 0 is the greatest distance.

    Args:
        plate: travel and where it is parked.
    """

    def __init__(
        self, device: ServedDevice, firmware: Firmware, link: ServerLink, plate: PlateDrive
    ) -> None:
        self._device, self._firmware, self._link, self._plate = device, firmware, link, plate
        firmware.hello = replace(firmware.hello, moves_plate=False)
        travel_mm = dict.fromkeys("XYZ", 1e3 * plate.z_max_m)
        self._stage = VirtualGrbl(travel_mm, 1e3 * (plate.z_park_m - plate.z_max_m))

    @property
    def speed(self) -> float:
        """Device seconds per wall second, of the stage as well."""
        return self._device.speed

    @property
    def host_since_s(self) -> float | None:
        """Wall time at which the present host came, None before any."""
        return self._device.host_since_s

    def receive(self, data: bytes, now_s: float) -> bytes:
        return self._device.receive(data, now_s)

    def tick(self, n: int, now_s: float) -> tuple[bytes, list[bytes]]:
        self._link.write(self._stage.step(self._link.read(), now_s * self.speed))
        self._firmware.carry_plate(self._plate.z_max_m + 1e-3 * self._stage.true_mm["Z"])
        return self._device.tick(n, now_s)

    def report_dropped(self, count: int) -> bytes:
        return self._device.report_dropped(count)


def stage_option(path: str, plate: PlateDrive) -> str:
    """Return the `--stage` of a host for the stage at a path."""
    return f"grbl:{path}?axis=Z&zero_mm={1e3 * plate.z_max_m:g}&direction=1"
