"""The host's end of a MAVLink link: who is there, acknowledged orders, heartbeats, messages."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import NamedTuple

from benchtool.bench.clocks import HostGapDetector
from benchtool.bench.identify import mismatch_message, probe_answer
from benchtool.bench.mavlink.frames import (
    AUTOPILOT_COMPONENT,
    GROUND_SYSTEM,
    SEQUENCE_MODULUS,
    MavlinkFrames,
    is_signed,
)
from benchtool.bench.mavlink.messages import AUTOPILOT_INVALID, MavCommand, Message, dialect
from benchtool.bench.transport.transport import MAX_WAIT_S, LinkEndpoint, Transport
from benchtool.core.errors import InputError, LinkLost, NoDevice, ProtocolError

HEARTBEAT_S = 1.0  # a ground station's heartbeat, as MAVLink asks
DISCOVERY_TIMEOUT_S = (
    5.0  # wait for a heartbeat: boards that reset when their port opens boot meanwhile
)
OTHER_HOST_TIMEOUT_S = (
    1.2  # so long after the first heartbeat others are waited for: each comes once a second
)

RETRY_INTERVALS_S = (0.15, 0.3, 0.6, 1.2, 1.5)
"""How long each try of an order waits. ArduPilot acknowledges in about 6 ms; behind MAVProxy on a
busy machine it took 0.7 s, on a line of 57,600 baud that is overfilled 3.0 s."""

PARAMETER_TIMEOUT_S = (0.6, 0.3)

REQUIRED_TIMEOUT_S = (
    0.6,
    0.9,
    1.5,
)  # an unknown parameter gets no answer; known: 0.1 s, to 3 s if busy

SILENCE_TIMEOUT_S = 0.3
"""Orders to turn end so long after the last bytes of the autopilot: nobody sees any more what its
outputs do. Outputs come at 10 Hz at least."""

FIRST_NUMBERS = 16
"""A frame below this number, where the last one was another one's neighbour, comes after a start:
an autopilot says a few frames only within the first second. A choice."""


class LinkGap(NamedTuple):
    """Describe a silence of the autopilot: its length, and whether its frames start over since."""

    silent_s: float
    from_start: bool


class MavlinkLink(LinkEndpoint):
    """Hold one conversation with an autopilot over a transport.

    Attributes:
        on_message: is given every message of that system with the wall time of its arrival.
        received_s: wall time of the autopilot's own last message.
        slowest_s: longest time that an acknowledgement took.
        gaps: how long `pump` was not called, or did not return.
    """

    def __init__(
        self,
        transport: Transport,
        address: str,
        clock: Callable[[], float],
        frames: MavlinkFrames,
    ) -> None:
        super().__init__(transport, address, clock)
        self.frames = frames
        self.system = 0
        self.component = AUTOPILOT_COMPONENT
        self.received_s = clock()
        self.slowest_s = 0.0
        self.gaps = HostGapDetector()
        self.on_message: Callable[[Message, float], None] = lambda message, arrived_s: None
        self.words = dialect()
        self._beat_s = -HEARTBEAT_S
        self._beats: dict[int, Message] = {}
        self._acks: dict[int, int] = {}
        self._sent_s: dict[int, float] = {}
        self._reported: dict[str, float] = {}
        self._number = 0
        self._gap: LinkGap | None = None

    def find(self, wanted: int | None) -> Message:
        """Open the transport, wait for heartbeats, choose a system; return its heartbeat.

        Args:
            wanted: number of the system; None takes the only one.

        Raises:
            PortBusy, PortDenied, NoDevice: the port cannot be had, or it stays silent.
            ProtocolError: what answers speaks something else, or with another key.
            InputError: several autopilots answer, or not the one that is wanted.
        """
        self.received = b""
        self.transport.open()
        deadline_s = self.clock() + DISCOVERY_TIMEOUT_S
        while self.clock() < deadline_s and wanted not in self._beats:
            before = len(self._beats)
            self.pump(MAX_WAIT_S)
            if len(self._beats) > before == 0:
                deadline_s = self.clock() + OTHER_HOST_TIMEOUT_S
        if not self._beats:
            raise self._silence()
        listed = ", ".join(str(system) for system in sorted(self._beats))
        if wanted is None and len(self._beats) > 1:
            raise InputError(
                f"{self.address} has {len(self._beats)} autopilots, systems {listed}; "
                f"choose one with system={min(self._beats)}"
            )
        if wanted is not None and wanted not in self._beats:
            raise InputError(
                f"{self.address} has no system {wanted}; it has {listed}; correct system="
            )
        self.system = wanted if wanted is not None else next(iter(self._beats))
        beat = self._beats[self.system]
        self.component = beat.get_srcComponent()
        return beat

    def send(self, message: Message) -> None:
        self.transport.write(self.frames.pack(message))

    def order(self, order: MavCommand) -> None:
        """Send an order and do not wait: its acknowledgement comes to `take_ack`."""
        self._sent_s.setdefault(order.command, self.clock())
        self.send(
            self.words.MAVLink_command_long_message(
                self.system, self.component, order.command, 0, *order.parameters
            )
        )

    def take_ack(self, command: int) -> int | None:
        """Return the result of the last acknowledgement of a command, once."""
        return self._acks.pop(command, None)

    def exchange(self, order: MavCommand, tries_s: tuple[float, ...] = RETRY_INTERVALS_S) -> int:
        """Send an order until it is acknowledged; return the result (MAV_RESULT).

        Args:
            order: not one that turns a motor.

        Raises:
            LinkLost: no answer to any try.
            ProtocolError: it signs its frames, we do not.
        """
        self._acks.pop(order.command, None)
        begun_s = self.clock()
        for wait_s in tries_s:
            self.order(order)
            result = self.wait(wait_s, lambda: self.take_ack(order.command))
            if result is not None:
                return result
        self._check_signed()
        raise LinkLost(
            f"{self.address} did not acknowledge command {order.command}, sent {len(tries_s)} "
            f"times in {self.clock() - begun_s:.1f} s; check the link, then start again"
        )

    def _check_signed(self) -> None:
        """Say why nothing is answered where a signature is wanted."""
        beat = self._beats.get(self.system)
        if not self.frames.signs and beat is not None and is_signed(beat):
            raise ProtocolError(
                f"{self.address} signs its frames and takes no order without a signature; give "
                f"its key as key=FILE"
            )

    def parameters(
        self, names: tuple[str, ...], required: tuple[str, ...] = ()
    ) -> dict[str, float]:
        """Return the parameters that the autopilot has; refuse one without a required one."""
        self._reported = {}
        for needed, tries_s in ((names, PARAMETER_TIMEOUT_S), (required, REQUIRED_TIMEOUT_S)):
            for wait_s in tries_s:
                self._request(needed, wait_s)
        if not self._reported:
            self._check_signed()
        if missing := [name for name in required if name not in self._reported]:
            raise ProtocolError(
                f"{self.address} did not report {', '.join(missing)} in "
                f"{sum(REQUIRED_TIMEOUT_S):g} s, so "
                f"that pulses could not be held within its range; check the link and the parameter"
            )
        return {name: self._reported[name] for name in names if name in self._reported}

    def _request(self, names: tuple[str, ...], wait_s: float) -> None:
        """Request the parameters that are not known yet, and wait for all of them."""
        missing = [name for name in names if name not in self._reported]
        for name in missing:
            request = self.words.MAVLink_param_request_read_message
            self.send(request(self.system, self.component, name.encode(), -1))
        self.wait(wait_s, lambda: all(name in self._reported for name in missing) or None)

    def pump(self, timeout_s: float) -> bool:
        now_s = self.clock()
        self.gaps.note(now_s)
        if now_s - self._beat_s >= HEARTBEAT_S:
            self._beat_s = now_s
            # A ground station (6) without an autopilot of its own, active.
            self.send(self.words.MAVLink_heartbeat_message(6, AUTOPILOT_INVALID, 0, 0, 4, 3))
        data = self.take(timeout_s)
        self.gaps.note(self.clock())
        if not data:
            return False
        arrived_s = self.clock()
        for message in self.frames.parse(data):
            source = message.get_srcSystem()
            if not self.system:
                # Who is there, before one is chosen.
                if message.msgname == "HEARTBEAT" and message.autopilot != AUTOPILOT_INVALID:
                    self._beats[source] = message
            elif source == self.system:
                self._sort(message, arrived_s)
        return True

    def _sort(self, message: Message, arrived_s: float) -> None:
        name = message.msgname
        if self.is_own(message):
            number = int(message.get_seq())
            if (silent_s := arrived_s - self.received_s) > SILENCE_TIMEOUT_S:
                skipped = (number - self._number - 1) % SEQUENCE_MODULUS
                self._gap = LinkGap(silent_s, number < FIRST_NUMBERS <= skipped)
            self.received_s, self._number = arrived_s, number
            # Another ground station's orders are acknowledged to that one.
            if name == "COMMAND_ACK" and message.target_system in (0, GROUND_SYSTEM):
                self._acks[message.command] = message.result
                sent_s = self._sent_s.pop(message.command, arrived_s)
                self.slowest_s = max(self.slowest_s, arrived_s - sent_s)
            elif name == "PARAM_VALUE":
                self._reported[str(message.param_id)] = _value(message)
        self.on_message(message, arrived_s)

    def is_own(self, message: Message) -> bool:
        """Return whether the autopilot itself sends it, no companion or gimbal of its system."""
        return bool(message.get_srcComponent() == self.component)

    def take_gap(self) -> LinkGap | None:
        """Return the last silence of the autopilot that is over, once."""
        gap, self._gap = self._gap, None
        return gap

    def _silence(self) -> NoDevice | ProtocolError:
        """Say what is there instead of an autopilot."""
        if self.frames.received:
            return ProtocolError(
                f"{self.address} carries MAVLink, but no autopilot's heartbeat came within "
                f"{DISCOVERY_TIMEOUT_S:g} s; check that the flight controller runs and is not "
                "behind a router"
            )
        if self.frames.unsigned:
            return ProtocolError(
                f"{self.address} carries MAVLink, but none of it bears a signature of this key; "
                f"check key= and the key that the autopilot was given"
            )
        if not self.received:
            self.received = probe_answer(self.transport, self.clock)
        if not self.received:
            return NoDevice(
                f"{self.address} is open, but nothing came for {DISCOVERY_TIMEOUT_S:g} s; check "
                f"power, and that the autopilot sends MAVLink to this port"
            )
        return ProtocolError(f"{self.address} {mismatch_message('mavlink', self.received)}")


INTEGER_TYPES = range(1, 9)  # MAV_PARAM_TYPE of whole numbers


def _value(message: Message) -> float:
    """Return a parameter's value.

    ArduPilot writes every one as a float. PX4 writes whole numbers bit by bit into the float's
    place, which as a float is next to nothing.
    """
    value = float(message.param_value)
    if message.param_type in INTEGER_TYPES and value != 0.0 and abs(value) < 1e-30:
        return float(struct.unpack("<i", struct.pack("<f", value))[0])
    return value
