"""The host's end of a MAVLink link: who is there, orders until acknowledged, heartbeats, news."""

from __future__ import annotations

import struct
from collections.abc import Callable

from benchtool.bench.mavlink_dialect import Message, dialect
from benchtool.bench.mavlink_frames import (
    AUTOPILOT_COMPONENT,
    GROUND_SYSTEM,
    MavlinkFrames,
    is_signed,
)
from benchtool.bench.mavlink_pilots import AUTOPILOT_INVALID, Order
from benchtool.bench.strangers import knocked, not_mavlink
from benchtool.bench.transport import Transport
from benchtool.errors import InputError, LinkLost, NoDevice, ProtocolError

HEARTBEAT_S = 1.0
"""A ground station's heartbeat, as MAVLink asks."""

FIND_S = 5.0
"""How long a heartbeat is waited for: boards that reset when their port opens boot meanwhile."""

OTHERS_S = 1.2
"""So long after the first heartbeat others are waited for: each comes once a second."""

ANSWER_S = 0.15
"""How long one try of an order waits; ArduPilot acknowledges in about 6 ms."""

TRIES = 4
PARAMETER_S = 0.6
"""An unknown parameter gets no answer at all; a known one answers in about 0.1 s."""

LONGEST_WAIT_S = 0.02
_SHOWN_BYTES = 200


class MavlinkTalk:
    """Hold one conversation with an autopilot over a transport.

    Attributes:
        system: number of the autopilot, known once it is found.
        on_message: is given every message of that system with the wall time of its arrival.

    Args:
        transport: carries the bytes.
        address: for messages.
        clock: monotonic wall clock in seconds.
        frames: packs and parses.
    """

    def __init__(
        self,
        transport: Transport,
        address: str,
        clock: Callable[[], float],
        frames: MavlinkFrames,
    ) -> None:
        self.transport = transport
        self.frames = frames
        self.system = 0
        self.on_message: Callable[[Message, float], None] = _ignore
        self.words = dialect()
        self._address = address
        self._clock = clock
        self._beat_s = -HEARTBEAT_S
        self._beats: dict[int, Message] = {}
        self._acks: dict[int, int] = {}
        self._told: dict[str, float] = {}
        self._heard = b""

    def find(self, wanted: int | None) -> Message:
        """Open the transport, wait for heartbeats, choose a system; return its heartbeat.

        Args:
            wanted: number of the system; None takes the only one.

        Raises:
            PortBusy, PortDenied, NoDevice: the port cannot be had, or it stays silent.
            ProtocolError: what answers speaks something else, or with another key.
            InputError: several autopilots answer, or not the one that is wanted.
        """
        self._heard = b""
        self.transport.open()
        deadline_s = self._clock() + FIND_S
        while self._clock() < deadline_s and wanted not in self._beats:
            before = len(self._beats)
            self.pump(LONGEST_WAIT_S)
            if len(self._beats) > before == 0:
                deadline_s = self._clock() + OTHERS_S
        if not self._beats:
            raise self._silence()
        if wanted is None and len(self._beats) > 1:
            raise InputError(
                f"{self._address} has {len(self._beats)} autopilots, systems {self._listed()}; "
                f"choose one with system={min(self._beats)}"
            )
        if wanted is not None and wanted not in self._beats:
            raise InputError(
                f"{self._address} has no system {wanted}; it has {self._listed()}; correct system="
            )
        self.system = wanted if wanted is not None else next(iter(self._beats))
        return self._beats[self.system]

    def send(self, message: Message) -> None:
        """Send a message."""
        self.transport.write(self.frames.pack(message))

    def order(self, order: Order) -> None:
        """Send an order and do not wait: its acknowledgement comes to `take_ack`."""
        self.send(
            self.words.MAVLink_command_long_message(
                self.system, AUTOPILOT_COMPONENT, order.command, 0, *order.parameters
            )
        )

    def take_ack(self, command: int) -> int | None:
        """Return the result of the last acknowledgement of a command, once, None without one."""
        return self._acks.pop(command, None)

    def exchange(self, order: Order) -> int:
        """Send an order until it is acknowledged; return the result (MAV_RESULT).

        Raises:
            LinkLost: no answer to any try.
            ProtocolError: it signs its frames, we do not.
        """
        self._acks.pop(order.command, None)
        for _ in range(TRIES):
            self.order(order)
            deadline_s = self._clock() + ANSWER_S
            while (left_s := deadline_s - self._clock()) > 0.0:
                self.pump(left_s)
                if (result := self.take_ack(order.command)) is not None:
                    return result
        beat = self._beats.get(self.system)
        if not self.frames.signs and beat is not None and is_signed(beat):
            raise ProtocolError(
                f"{self._address} signs its frames and takes no order without a signature; give "
                f"its key as key=FILE"
            )
        raise LinkLost(
            f"{self._address} did not acknowledge command {order.command} in {TRIES} tries of "
            f"{1000.0 * ANSWER_S:.0f} ms; motors stop by themselves; check the link, then start "
            f"again"
        )

    def parameters(self, names: tuple[str, ...]) -> dict[str, float]:
        """Return the values of those parameters that the autopilot has."""
        self._told = {}
        for attempt in range(2):
            for name in names:
                if name not in self._told:
                    self.send(
                        self.words.MAVLink_param_request_read_message(
                            self.system, AUTOPILOT_COMPONENT, name.encode(), -1
                        )
                    )
            deadline_s = self._clock() + PARAMETER_S / (1 + attempt)
            while (left_s := deadline_s - self._clock()) > 0.0:
                if all(name in self._told for name in names):
                    break
                self.pump(left_s)
        return {name: self._told[name] for name in names if name in self._told}

    def pump(self, timeout_s: float) -> bool:
        """Send a heartbeat when one is due and take what arrives within a short wait.

        Returns:
            whether anything arrived.
        """
        now_s = self._clock()
        if now_s - self._beat_s >= HEARTBEAT_S:
            self._beat_s = now_s
            # A ground station (6) without an autopilot of its own, active.
            self.send(self.words.MAVLink_heartbeat_message(6, AUTOPILOT_INVALID, 0, 0, 4, 3))
        data = self.transport.read(min(timeout_s, LONGEST_WAIT_S))
        if not data:
            return False
        if len(self._heard) < _SHOWN_BYTES:
            self._heard = (self._heard + data)[:_SHOWN_BYTES]
        arrived_s = self._clock()
        for message in self.frames.parse(data):
            source = message.get_srcSystem()
            if not self.system:
                self._meet(message)
            elif source == self.system:
                self._sort(message, arrived_s)
        return True

    def _meet(self, message: Message) -> None:
        """Note who is there, before one is chosen."""
        if message.msgname == "HEARTBEAT" and message.autopilot != AUTOPILOT_INVALID:
            self._beats[message.get_srcSystem()] = message

    def _sort(self, message: Message, arrived_s: float) -> None:
        name = message.msgname
        if name == "COMMAND_ACK":
            # Another ground station's orders are acknowledged to that one.
            if message.target_system in (0, GROUND_SYSTEM):
                self._acks[message.command] = message.result
        elif name == "PARAM_VALUE":
            self._told[str(message.param_id)] = _value(message)
        self.on_message(message, arrived_s)

    def _listed(self) -> str:
        return ", ".join(str(system) for system in sorted(self._beats))

    def _silence(self) -> NoDevice | ProtocolError:
        """Say what is there instead of an autopilot."""
        if self.frames.heard:
            return ProtocolError(
                f"{self._address} carries MAVLink, but no autopilot's heartbeat came within "
                f"{FIND_S:g} s; check that the flight controller runs and is not behind a router"
            )
        if self.frames.unsigned:
            return ProtocolError(
                f"{self._address} carries MAVLink, but none of it bears a signature of this key; "
                f"check key= and the key that the autopilot was given"
            )
        if not self._heard:
            self._heard = knocked(self.transport, self._clock)
        if not self._heard:
            return NoDevice(
                f"{self._address} is open, but nothing came for {FIND_S:g} s; check power, and "
                f"that the autopilot sends MAVLink to this port (`benchtool doctor` tries each "
                f"cause)"
            )
        return ProtocolError(f"{self._address} {not_mavlink(self._heard)}")


def _ignore(message: Message, arrived_s: float) -> None:
    """Pass a message over."""


INTEGER_TYPES = range(1, 9)
"""MAV_PARAM_TYPE of whole numbers."""


def _value(message: Message) -> float:
    """Return a parameter's value.

    ArduPilot writes every one as a float. PX4 writes whole numbers bit by bit into the float's
    place, which as a float is next to nothing.
    """
    value = float(message.param_value)
    if message.param_type in INTEGER_TYPES and value != 0.0 and abs(value) < 1e-30:
        return float(struct.unpack("<i", struct.pack("<f", value))[0])
    return value
