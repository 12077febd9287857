"""MAVLink frames and time stamps: encoding, decoding, loss counts, boot time. Pure functions."""

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
# Largest delay of a frame in frames, a quarter of the modulus; a link that reorders is off by a
# few, a restarted autopilot by any number; assumed.
REORDER_WINDOW = 64

MAVLINK_2, SIGNED = 0xFD, 1  # first byte of a frame of MAVLink 2; bit of a signed frame
SIGNING_EPOCH_S = 1_420_070_400.0  # 2015-01-01 UTC (MAVLink 2 message signing)


@dataclass(slots=True)
class LinkCounts:
    """Counts of frames.

    Attributes:
        lost: missing sequence numbers, over all components of a system.
        corrupt: discarded for checksum or signature.
        reordered: received after a later one.
    """

    messages: int = 0
    lost: int = 0
    corrupt: int = 0
    duplicates: int = 0
    reordered: int = 0

    def add(self, other: LinkCounts) -> None:
        for count in fields(self):
            setattr(self, count.name, getattr(self, count.name) + getattr(other, count.name))


@dataclass(slots=True)
class _Source:
    """Sequence numbers of one component; each has its own."""

    last: int | None = None
    recent: OrderedDict[int, bytes] = field(default_factory=OrderedDict)
    missing: set[int] = field(default_factory=set)
    counts: LinkCounts = field(default_factory=LinkCounts)
    unnumbered: bool = False

    def take(self, number: int, frame: bytes) -> bool:
        """Count a frame; return whether it is new.

        A component with the same number in all frames, as some scripts send, can have neither
        lost nor duplicate frames.
        """
        previous = self.recent.get(number, frame)
        if number == self.last and frame != previous:
            self.unnumbered = True
        if self.unnumbered:
            self.counts.messages += 1
            return True
        if number in self.recent and frame == previous:
            self.counts.duplicates += 1
            return False
        step = 0 if self.last is None else (number - self.last) % SEQUENCE_MODULUS
        if step >= SEQUENCE_MODULUS - REORDER_WINDOW and number in self.missing:
            self.missing.discard(number)
            self.counts.lost -= 1
            self.counts.reordered += 1
        else:
            if 1 < step < SEQUENCE_MODULUS - REORDER_WINDOW:
                # A restarted count also loses the numbers in between.
                self.counts.lost += step - 1
                self.missing |= {
                    (number - seq) % SEQUENCE_MODULUS for seq in range(1, min(step, REORDER_WINDOW))
                }
            self.last = number
            if self.missing:
                ages = {seq: (number - seq) % SEQUENCE_MODULUS for seq in self.missing}
                self.missing = {seq for seq, age in ages.items() if 0 < age < REORDER_WINDOW}
        self.counts.messages += 1
        self.recent[number] = frame
        self.recent.move_to_end(number)
        if len(self.recent) > REORDER_WINDOW:
            self.recent.popitem(last=False)
        return True


class MavlinkFrames:
    """Packer and parser of messages for one system.

    Attributes:
        corrupt: frames discarded since the last `take_counts`, for checksum or signature.
        unsigned: number of all frames so far that were rejected for their signature.
        received: at least one valid frame was received.
        signs: sent frames are signed, and received frames must be.

    Args:
        key: 32 bytes to sign sent frames and check received ones; None disables signing.
        now_s: time since 1970, for the signatures.
        counts: False accepts every frame, as an autopilot does: the next host restarts its numbers,
            and its first frames may equal those of the previous host.
    """

    def __init__(
        self,
        system: int = GROUND_SYSTEM,
        component: int = GROUND_COMPONENT,
        key: bytes | None = None,
        now_s: float = 0.0,
        counts: bool = True,
    ) -> None:
        module = dialect()
        self._counts = counts
        self.corrupt = self.unsigned = 0
        self.received = False
        self._sources: dict[tuple[int, int], _Source] = {}
        self._lost_carry: dict[int, int] = {}
        self._bad = module.MAVLink_bad_data
        self._mav = module.MAVLink(None, system, component)
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
        """Return the messages that `data` completes; invalid bytes never raise."""
        good = []
        for message in (self._mav.parse_buffer(data) if data else None) or ():
            if type(message) is self._bad:
                # Text and boot messages before the first frame do not count as corrupt.
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
        """Return the counts of all components of a system since the last call.

        Sequence numbers wrap at 256, so a gap of 256 or more is underestimated.
        """
        counts = LinkCounts(corrupt=self.corrupt)
        for (owner, _), state in self._sources.items():
            if owner == system:
                counts.add(state.counts)
                state.counts = LinkCounts()
        # A late frame is subtracted in the call in which it arrives, or in later ones.
        counts.lost += self._lost_carry.get(system, 0)
        self._lost_carry[system] = min(counts.lost, 0)
        counts.lost = max(counts.lost, 0)
        self.corrupt = 0
        return counts


def is_signed(message: Message) -> bool:
    """Return whether a message has a signature, checked or not."""
    frame = bytes(message.get_msgbuf())
    return frame[0] == MAVLINK_2 and bool(frame[2] & SIGNED)


class MavlinkQuality:
    """Message counts and the jitter of their arrival.

    Jitter is the standard deviation of arrival time minus the autopilot's time, over steps between
    consecutive messages (RFC 3550 smooths the same quantity).
    """

    def __init__(self) -> None:
        self.counts = LinkCounts()
        self._steps = 0
        self._squares_s2 = 0.0
        self._previous: tuple[float, float] | None = None

    def arrived(self, arrived_s: float, device_s: float) -> None:
        """Record the arrival and creation time of a message, each on its own clock."""
        if self._previous is not None and device_s > self._previous[1]:
            step_s = (arrived_s - self._previous[0]) - (device_s - self._previous[1])
            self._steps += 1
            self._squares_s2 += step_s**2
        self._previous = (arrived_s, device_s)

    def facts(self) -> dict[str, str]:
        counts, jitter_s = self.counts, sqrt(self._squares_s2 / max(self._steps, 1))
        return {
            "link_lost": f"{counts.lost} of {counts.messages + counts.lost} messages",
            "link_duplicates": str(counts.duplicates),
            "link_reordered": str(counts.reordered),
            "link_jitter_ms": f"{1e3 * jitter_s:.2f}",
        }


TIME_MODULUS = 1 << 32
MAX_BACKWARD_US = 2_000_000  # a larger step back is a restart, not reordering; assumed

# A larger step ahead is a restart as well, because through a wrap a step back is one ahead. A link
# that was silent for so long has already ended its run; assumed.
MAX_FORWARD_US = 600_000_000

EPOCH_US = 1 << 50  # larger stamps (35 years) are since 1970, not since boot; MAVLink allows both


class BootTime:
    """Time since boot, unwrapped from all kinds of stamps: microseconds.

    `SERVO_OUTPUT_RAW.time_usec` has 32 bits and wraps after 71.6 minutes, `time_boot_ms` after
    49.7 days. A message without a stamp gets the last one.

    Attributes:
        last_us: newest time.
        rebooted: the clock has restarted; time then continues from the last stamp.
    """

    def __init__(self) -> None:
        self.last_us = 0
        self.rebooted = False
        self._is_anchored = False
        self._offset_us = 0

    def us32(self, stamp: int) -> int:
        return self._unwrap(stamp, TIME_MODULUS, cannot_wrap=False)

    def ms32(self, stamp: int) -> int:
        return self._unwrap(1000 * stamp, 1000 * TIME_MODULUS)

    def us64(self, stamp: int) -> int:
        """Return the time of a 64-bit stamp; one since 1970 is replaced by the newest time."""
        return self.last_us if stamp == 0 or stamp >= EPOCH_US else self._unwrap(stamp, 1 << 64)

    def message_time_us(self, message: Message) -> int:
        """Return the time of a message from its stamp; without one, the newest time."""
        if (boot_ms := getattr(message, "time_boot_ms", None)) is not None:
            return self.ms32(boot_ms)
        if (stamp := getattr(message, "time_usec", None)) is not None:
            return self.us64(stamp)
        return self.last_us

    def _unwrap(self, stamp: int, modulus: int, cannot_wrap: bool = True) -> int:
        if not self._is_anchored and (cannot_wrap or not self.last_us):
            # The first stamp that cannot have wrapped sets the time since boot.
            self._is_anchored = cannot_wrap
            self.last_us = stamp
            return stamp
        step = (stamp + self._offset_us - self.last_us + modulus // 2) % modulus - modulus // 2
        if not -MAX_BACKWARD_US <= step <= MAX_FORWARD_US:
            self.rebooted = True
            # New times follow earlier ones, so that a recording's time never decreases.
            self._offset_us -= step
            step = 0
        self.last_us = max(self.last_us, self.last_us + step)
        return self.last_us if step > 0 else self.last_us + step


class CompanionTime:
    """Stamps of another component in the autopilot's time.

    The component has a separate clock. Its messages arrive no sooner than they were sent, so the
    smallest recent delay is the offset of the two clocks.
    """

    def __init__(self) -> None:
        self._boot, self._clock = BootTime(), DeviceClock()

    def us(self, stamp_ms: int, arrived_us: int) -> int:
        """Return a 32-bit stamp in ms as the autopilot's us, from its arrival time."""
        sent_us = self._boot.ms32(stamp_ms)
        if self._boot.rebooted:
            self._boot, self._clock = BootTime(), DeviceClock()
            sent_us = self._boot.ms32(stamp_ms)
        self._clock.update(sent_us, 1e-6 * arrived_us)
        time_s = self._clock.host_time_s(np.array([sent_us], np.int64))[0]
        return min(round(1e6 * float(time_s)), arrived_us)
