"""MAVLink's bytes: frames to messages and back, with what was lost on the way. Pure."""

from __future__ import annotations

from collections import defaultdict

from benchtool.bench.mavlink_dialect import Message, dialect

GROUND_SYSTEM, GROUND_COMPONENT = 255, 190
"""How a ground station names itself (MAVLink's conventions: system 255, mission planner)."""

AUTOPILOT_COMPONENT = 1

SEQUENCE_MODULUS = 256

MAVLINK_2, SIGNED = 0xFD, 1
"""First byte of a frame of MAVLink 2, and the bit of its third that says that it is signed."""

SIGNING_EPOCH_S = 1_420_070_400.0
"""Signing counts tens of microseconds since 2015-01-01 UTC (MAVLink 2 message signing)."""


class MavlinkFrames:
    """Pack and parse messages in the name of one system.

    Attributes:
        corrupt: frames thrown away since the last `take_losses`, for checksum or signature.
        unsigned: how many of all corrupt frames so far were refused for their signature.
        heard: whether any whole frame was understood yet.
        signs: whether what is sent bears a signature, and what comes must.

    Args:
        system: our own number.
        component: our own component number.
        key: 32 bytes that sign what is sent and check what comes; None signs nothing.
        now_s: time since 1970, for the signatures.
    """

    def __init__(
        self,
        system: int = GROUND_SYSTEM,
        component: int = GROUND_COMPONENT,
        key: bytes | None = None,
        now_s: float = 0.0,
    ) -> None:
        words = dialect()
        self.corrupt = self.unsigned = 0
        self.heard = False
        self._lost: defaultdict[int, int] = defaultdict(int)
        self._count: defaultdict[int, int] = defaultdict(int)
        self._last: dict[tuple[int, int], int] = {}
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
        """Return a message as the bytes of one frame, MAVLink 2."""
        frame: bytes = bytes(message.pack(self._mav))
        self._mav.seq = (self._mav.seq + 1) % SEQUENCE_MODULUS
        return frame

    def parse(self, data: bytes) -> list[Message]:
        """Return the messages that `data` completes; garbage never raises."""
        found = self._mav.parse_buffer(data) if data else None
        if not found:
            return []
        good = []
        last, bad = self._last, self._bad
        for message in found:
            if type(message) is bad:
                self._refuse(message)
                continue
            source = (message.get_srcSystem(), message.get_srcComponent())
            number = message.get_seq()
            before = last.get(source)
            if before is not None:
                skipped = (number - before - 1) % SEQUENCE_MODULUS
                if skipped:
                    self._lost[source[0]] += skipped
            last[source] = number
            self._count[source[0]] += 1
            good.append(message)
        self.heard = self.heard or bool(good)
        return good

    def take_losses(self, system: int) -> tuple[int, int, int]:
        """Return messages received and lost of a system, and corrupt frames, since the last call.

        Lost is what the sequence numbers say; they count modulo 256, so that a gap of 256 and more
        counts as less than it was.
        """
        counts = self._count.pop(system, 0), self._lost.pop(system, 0), self.corrupt
        self.corrupt = 0
        return counts

    def _refuse(self, message: Message) -> None:
        """Count a frame that is none; text and boot messages before the first one do not count."""
        if "signature" in str(message.reason):
            self.unsigned += 1
        if self.heard or "signature" in str(message.reason):
            self.corrupt += 1


def is_signed(message: Message) -> bool:
    """Tell whether a message came in a frame with a signature, whether or not it was checked."""
    frame = bytes(message.get_msgbuf())
    return frame[0] == MAVLINK_2 and bool(frame[2] & SIGNED)
