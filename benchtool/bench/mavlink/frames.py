"""MAVLink's bytes and stamps: to messages and back, what was lost, an autopilot's time. Pure."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field, fields
from math import sqrt

import numpy as np

from benchtool.bench.clocks import DeviceClock
from benchtool.bench.mavlink.messages import Message, dialect

GROUND_SYSTEM, GROUND_COMPONENT = 255, 190  # ids of a ground station (MAVLink convention)

AUTOPILOT_COMPONENT = 1
SEQUENCE_MODULUS = 256
WINDOW = 64
"""A frame may come so many frames late and is still that one: a link that reorders is off by a few,
an autopilot that started again by any number. A choice, a quarter of the modulus."""

MAVLINK_2, SIGNED = 0xFD, 1  # first byte of a frame of MAVLink 2; bit of a signed frame
SIGNING_EPOCH_S = 1_420_070_400.0  # 2015-01-01 UTC (MAVLink 2 message signing)


@dataclass(slots=True)
class LinkCounts:
    """Count frames.

    Attributes:
        lost: that the sequence numbers miss, over all components of a system.
        corrupt: discarded for checksum or signature.
        reordered: that came after a later one.
    """

    messages: int = 0
    lost: int = 0
    corrupt: int = 0
    duplicates: int = 0
    reordered: int = 0

    def add(self, other: LinkCounts) -> None:
        for each in fields(self):
            setattr(self, each.name, getattr(self, each.name) + getattr(other, each.name))


@dataclass(slots=True)
class _Source:
    """Follow the sequence numbers of one component; each counts its own."""

    last: int | None = None
    recent: OrderedDict[int, bytes] = field(default_factory=OrderedDict)
    missing: set[int] = field(default_factory=set)
    counts: LinkCounts = field(default_factory=LinkCounts)
    unnumbered: bool = False

    def take(self, number: int, frame: bytes) -> bool:
        """Note a frame; return whether it is a new one.

        A component that numbers all its frames alike, as some scripts do, has none that could be
        missed or be there twice.
        """
        before = self.recent.get(number, frame)
        if number == self.last and frame != before:
            self.unnumbered = True
        if self.unnumbered:
            self.counts.messages += 1
            return True
        if number in self.recent and frame == before:
            self.counts.duplicates += 1
            return False
        step = 0 if self.last is None else (number - self.last) % SEQUENCE_MODULUS
        if step >= SEQUENCE_MODULUS - WINDOW and number in self.missing:
            self.missing.discard(number)
            self.counts.lost -= 1
            self.counts.reordered += 1
        else:
            if 1 < step < SEQUENCE_MODULUS - WINDOW:
                # A number that counts from its beginning anew has lost what lies between as well.
                self.counts.lost += step - 1
                self.missing |= {
                    (number - back) % SEQUENCE_MODULUS for back in range(1, min(step, WINDOW))
                }
            self.last = number
            if self.missing:
                ages = {back: (number - back) % SEQUENCE_MODULUS for back in self.missing}
                self.missing = {back for back, age in ages.items() if 0 < age < WINDOW}
        self.counts.messages += 1
        self.recent[number] = frame
        self.recent.move_to_end(number)
        if len(self.recent) > WINDOW:
            self.recent.popitem(last=False)
        return True


class MavlinkFrames:
    """Pack and parse messages in the name of one system.

    Attributes:
        corrupt: frames discarded since the last `take_counts`, for checksum or signature.
        unsigned: how many of all corrupt frames so far were refused for their signature.
        received: whether any whole frame was understood yet.
        signs: whether what is sent bears a signature, and what comes must.

    Args:
        key: 32 bytes that sign what is sent and check what comes; None signs nothing.
        now_s: time since 1970, for the signatures.
        counts: False takes every frame as it comes, as an autopilot does: the next host begins its
            numbers anew, and its first frames may be those of the one before.
    """

    def __init__(
        self,
        system: int = GROUND_SYSTEM,
        component: int = GROUND_COMPONENT,
        key: bytes | None = None,
        now_s: float = 0.0,
        counts: bool = True,
    ) -> None:
        words = dialect()
        self._counts = counts
        self.corrupt = self.unsigned = 0
        self.received = False
        self._sources: dict[tuple[int, int], _Source] = {}
        self._owed: dict[int, int] = {}
        self._bad = words.MAVLink_bad_data
        self._mav = words.MAVLink(None, system, component)
        self._mav.robust_parsing = True
        self.signs = key is not None
        if key is not None:
            signing = self._mav.signing
            signing.secret_key, signing.sign_outgoing = key, True
            signing.link_id = 0
            signing.timestamp = max(0, round((now_s - SIGNING_EPOCH_S) * 1e5))

    def pack(self, message: Message) -> bytes:
        frame: bytes = bytes(message.pack(self._mav))
        self._mav.seq = (self._mav.seq + 1) % SEQUENCE_MODULUS
        return frame

    def parse(self, data: bytes) -> list[Message]:
        """Return the messages that `data` completes; garbage never raises."""
        good = []
        for message in (self._mav.parse_buffer(data) if data else None) or ():
            if type(message) is self._bad:
                # Text and boot messages before the first frame are no corrupt ones.
                unsigned = "signature" in str(message.reason)
                self.unsigned += unsigned
                self.corrupt += self.received or unsigned
                continue
            if not self._counts:
                good.append(message)
                continue
            source = (message.get_srcSystem(), message.get_srcComponent())
            state = self._sources.setdefault(source, _Source())
            if state.take(message.get_seq(), bytes(message.get_msgbuf())):
                good.append(message)
        self.received = self.received or bool(good)
        return good

    def take_counts(self, system: int) -> LinkCounts:
        """Return what came and what did not, of every component of a system, since the last call.

        Sequence numbers count modulo 256, so that a gap of 256 and more counts as less than it was.
        """
        counts = LinkCounts(corrupt=self.corrupt)
        for (owner, _), state in self._sources.items():
            if owner == system:
                counts.add(state.counts)
                state.counts = LinkCounts()
        # One that was late is subtracted in the call in which it came, or in the next ones.
        counts.lost += self._owed.get(system, 0)
        self._owed[system] = min(counts.lost, 0)
        counts.lost = max(counts.lost, 0)
        self.corrupt = 0
        return counts


def is_signed(message: Message) -> bool:
    """Return whether a message came in a frame with a signature, whether or not it was checked."""
    frame = bytes(message.get_msgbuf())
    return frame[0] == MAVLINK_2 and bool(frame[2] & SIGNED)


class MavlinkQuality:
    """Count messages and measure how unevenly they arrive.

    Jitter is the standard deviation of arrival time minus the autopilot's own time, over steps from
    one message to the next (RFC 3550 smooths the same quantity).
    """

    def __init__(self) -> None:
        self.counts = LinkCounts()
        self._steps = 0
        self._squares_s2 = 0.0
        self._before: tuple[float, float] | None = None

    def arrived(self, arrived_s: float, device_s: float) -> None:
        """Note when a message came and when it was made, each on its own clock."""
        if self._before is not None and device_s > self._before[1]:
            step_s = (arrived_s - self._before[0]) - (device_s - self._before[1])
            self._steps += 1
            self._squares_s2 += step_s**2
        self._before = (arrived_s, device_s)

    def facts(self) -> dict[str, str]:
        counts, jitter_s = self.counts, sqrt(self._squares_s2 / max(self._steps, 1))
        return {
            "link_lost": f"{counts.lost} of {counts.messages + counts.lost} messages",
            "link_duplicates": str(counts.duplicates),
            "link_reordered": str(counts.reordered),
            "link_jitter_ms": f"{1e3 * jitter_s:.2f}",
        }


MODULUS = 1 << 32
REBOOT_US = 2_000_000  # a clock so far back has restarted; reordering is less; assumed

LEAP_US = 600_000_000
"""A clock that leaps ahead by more has begun anew as well: seen through a wrap, back is ahead. A
link that was silent for so long has ended its run before. A choice."""

EPOCH_US = 1 << 50  # stamps above (35 years) count since 1970, not since boot; MAVLink allows both


class BootTime:
    """Unwrap stamps of every kind onto one count of microseconds.

    `SERVO_OUTPUT_RAW.time_usec` holds 32 bits and wraps after 71.6 minutes, `time_boot_ms` after
    49.7 days. A message without a stamp happened at the last one.

    Attributes:
        last_us: of the newest stamp.
        rebooted: whether the clock has begun anew; time goes on from the last stamp then.
    """

    def __init__(self) -> None:
        self.last_us = 0
        self.rebooted = False
        self._anchored = False
        self._offset_us = 0

    def us32(self, stamp: int) -> int:
        return self._nearest(stamp, MODULUS, whole=False)

    def ms32(self, stamp: int) -> int:
        return self._nearest(1000 * stamp, 1000 * MODULUS)

    def us64(self, stamp: int) -> int:
        """Return a stamp of 64 bits; one since 1970 says nothing about the boot."""
        return self.last_us if stamp == 0 or stamp >= EPOCH_US else self._nearest(stamp, 1 << 64)

    def of(self, message: Message) -> int:
        """Return when a message was made: by its stamp, else at the last one."""
        if (boot_ms := getattr(message, "time_boot_ms", None)) is not None:
            return self.ms32(boot_ms)
        if (stamp := getattr(message, "time_usec", None)) is not None:
            return self.us64(stamp)
        return self.last_us

    def _nearest(self, stamp: int, modulus: int, whole: bool = True) -> int:
        if not self._anchored and (whole or not self.last_us):
            # The first stamp that cannot have wrapped says how long it has been up.
            self._anchored = whole
            self.last_us = stamp
            return stamp
        step = (stamp + self._offset_us - self.last_us + modulus // 2) % modulus - modulus // 2
        if not -REBOOT_US <= step <= LEAP_US:
            self.rebooted = True
            # What comes now lies behind what came before: no time of a recording runs backwards.
            self._offset_us -= step
            step = 0
        self.last_us = max(self.last_us, self.last_us + step)
        return self.last_us if step > 0 else self.last_us + step


class CompanionTime:
    """Lay the stamps of another component on the autopilot's time.

    It has a clock of its own. What it stamps arrives no sooner than it was sent, so that the
    smallest delay lately seen shows how far the two clocks are apart.
    """

    def __init__(self) -> None:
        self._boot, self._clock = BootTime(), DeviceClock()

    def us(self, stamp_ms: int, arrived_us: int) -> int:
        """Return a stamp of 32 bits in ms as the autopilot's us, from when it arrived."""
        sent_us = self._boot.ms32(stamp_ms)
        if self._boot.rebooted:
            self._boot, self._clock = BootTime(), DeviceClock()
            sent_us = self._boot.ms32(stamp_ms)
        self._clock.learn(sent_us, 1e-6 * arrived_us)
        at_s = self._clock.host_time_s(np.array([sent_us], np.int64))[0]
        return min(round(1e6 * float(at_s)), arrived_us)
