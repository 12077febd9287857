"""Host endpoint of a MAVLink link: discovery, acknowledged commands, heartbeats, messages."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import NamedTuple

from benchtool.bench.identify import mismatch_message, probe_answer
from benchtool.bench.mavlink.frames import (
    AUTOPILOT_COMPONENT,
    AUTOPILOT_INVALID,
    GROUND_SYSTEM,
    SEQUENCE_MODULUS,
    MavCommand,
    MavlinkFrames,
    Message,
    dialect,
    is_signed,
)
from benchtool.bench.transport.transport import MAX_WAIT_S, LinkEndpoint, Transport
from benchtool.core.errors import InputError, LinkLost, NoDevice, ProtocolError

HEARTBEAT_S = 1.0  # interval of a ground station's heartbeat, as MAVLink recommends
DISCOVERY_TIMEOUT_S = 5.0  # for a heartbeat: boards that reset on opening boot meanwhile
OTHER_HOST_TIMEOUT_S = 1.2  # for further systems after the first heartbeat, one per second

# Timeout of each attempt of a command. ArduPilot acknowledges in about 6 ms; behind MAVProxy on a
# busy machine it took 0.7 s, on an overfilled line of 57,600 baud 3.0 s.
RETRY_INTERVALS_S = (0.15, 0.3, 0.6, 1.2, 1.5)

PARAMETER_TIMEOUT_S = (0.6, 0.3)
REQUIRED_TIMEOUT_S = (0.6, 0.9, 1.5)  # no reply to an unknown parameter; known: 0.1 s, busy: 3 s

# Motor commands end this long after the autopilot's last bytes, because its outputs are unknown
# then. Outputs come at 10 Hz at least.
SILENCE_TIMEOUT_S = 0.3

# A frame below this number that does not follow the last one comes after a restart: an autopilot
# sends only a few frames within the first second; assumed.
MAX_RESTART_NUMBER = 16


class LinkGap(NamedTuple):
    """Dropout of the autopilot: its duration, and whether its frame numbers restarted."""

    silent_s: float
    from_start: bool


class MavlinkLink(LinkEndpoint):
    """Link to an autopilot over a transport."""

    def __init__(
        self, transport: Transport, address: str, clock: Callable[[], float], frames: MavlinkFrames
    ) -> None:
        super().__init__(transport, address, clock)
        self.frames = frames
        self.system = 0
        self.component = AUTOPILOT_COMPONENT
        self.received_s = clock()  # wall time of the autopilot's last message
        self.slowest_s = 0.0  # longest delay of an acknowledgement
        # Callback for every message of the system, with the wall time of its arrival
        self.on_message: Callable[[Message, float], None] = lambda message, arrived_s: None
        self.dialect = dialect()
        self._heartbeat_s = -HEARTBEAT_S
        self._heartbeats: dict[int, Message] = {}
        self._acks: dict[int, int] = {}
        self._sent_s: dict[int, float] = {}
        self._reported: dict[str, float] = {}
        self._number = 0
        self._gap: LinkGap | None = None

    def find(self, system: int | None) -> Message:
        """Open the transport; return the heartbeat of a system, by default of the only one."""
        self.received = b""
        self.transport.open()
        deadline_s = self.clock() + DISCOVERY_TIMEOUT_S
        while self.clock() < deadline_s and system not in self._heartbeats:
            n_systems = len(self._heartbeats)
            self.pump(MAX_WAIT_S)
            if len(self._heartbeats) > n_systems == 0:
                deadline_s = self.clock() + OTHER_HOST_TIMEOUT_S
        if not self._heartbeats:
            raise self._discovery_error()
        listed = ", ".join(str(system_id) for system_id in sorted(self._heartbeats))
        if system is None and len(self._heartbeats) > 1:
            raise InputError(
                f"{self.address} has {len(self._heartbeats)} autopilots, systems {listed}; "
                f"choose one with system={min(self._heartbeats)}"
            )
        if system is not None and system not in self._heartbeats:
            raise InputError(
                f"{self.address} has no system {system}; it has {listed}; correct system="
            )
        self.system = system if system is not None else next(iter(self._heartbeats))
        heartbeat = self._heartbeats[self.system]
        self.component = heartbeat.get_srcComponent()
        return heartbeat

    def send(self, message: Message) -> None:
        self.transport.write(self.frames.pack(message))

    def send_command(self, command: MavCommand) -> None:
        """Send a command without waiting; `take_ack` returns its acknowledgement."""
        self._sent_s.setdefault(command.command, self.clock())
        self.send(
            self.dialect.MAVLink_command_long_message(
                self.system, self.component, command.command, 0, *command.parameters
            )
        )

    def take_ack(self, command: int) -> int | None:
        """Return and clear the result of the last acknowledgement of a command."""
        return self._acks.pop(command, None)

    def exchange(self, command: MavCommand, waits_s: tuple[float, ...] = RETRY_INTERVALS_S) -> int:
        """Send a command, not of a motor, until it is acknowledged; return its MAV_RESULT.

        Raises:
            LinkLost: no acknowledgement of any attempt.
            ProtocolError: the autopilot requires signed frames, and no key is set.
        """
        self._acks.pop(command.command, None)
        start_s = self.clock()
        for timeout_s in waits_s:
            self.send_command(command)
            result = self.wait(timeout_s, lambda: self.take_ack(command.command))
            if result is not None:
                return result
        self._raise_if_signature_needed()
        raise LinkLost(
            f"{self.address} did not acknowledge command {command.command}, sent {len(waits_s)} "
            f"times in {self.clock() - start_s:.1f} s; check the link, then start again"
        )

    def _raise_if_signature_needed(self) -> None:
        """Raise if the missing replies are explained by a missing signature."""
        heartbeat = self._heartbeats.get(self.system)
        if not self.frames.signs and heartbeat is not None and is_signed(heartbeat):
            raise ProtocolError(
                f"{self.address} signs its frames and accepts no command without a signature; "
                f"give its key as key=FILE"
            )

    def read_parameters(
        self, names: tuple[str, ...], required: tuple[str, ...] = ()
    ) -> dict[str, float]:
        """Return the available parameters; raise if a required one is missing."""
        self._reported = {}
        for group, timeouts_s in ((names, PARAMETER_TIMEOUT_S), (required, REQUIRED_TIMEOUT_S)):
            for timeout_s in timeouts_s:
                self._request_parameters(group, timeout_s)
        if not self._reported:
            self._raise_if_signature_needed()
        if missing := [name for name in required if name not in self._reported]:
            raise ProtocolError(
                f"{self.address} did not report {', '.join(missing)} in "
                f"{sum(REQUIRED_TIMEOUT_S):g} s, needed for its range of pulse widths; check the "
                f"link and the parameter"
            )
        return {name: self._reported[name] for name in names if name in self._reported}

    def _request_parameters(self, names: tuple[str, ...], timeout_s: float) -> None:
        """Request the parameters that are still missing, and wait for all of them."""
        missing = [name for name in names if name not in self._reported]
        for name in missing:
            request = self.dialect.MAVLink_param_request_read_message
            self.send(request(self.system, self.component, name.encode(), -1))
        self.wait(timeout_s, lambda: all(name in self._reported for name in missing) or None)

    def _send_due_heartbeat(self, now_s: float) -> None:
        if now_s - self._heartbeat_s >= HEARTBEAT_S:
            self._heartbeat_s = now_s
            # A ground station (6) without an autopilot, active.
            self.send(self.dialect.MAVLink_heartbeat_message(6, AUTOPILOT_INVALID, 0, 0, 4, 3))

    def _process(self, data: bytes) -> None:
        arrived_s = self.clock()
        for message in self.frames.parse(data):
            source = message.get_srcSystem()
            if not self.system:
                # Discovery, before a system is chosen.
                if message.msgname == "HEARTBEAT" and message.autopilot != AUTOPILOT_INVALID:
                    self._heartbeats[source] = message
            elif source == self.system:
                self._process_message(message, arrived_s)

    def _process_message(self, message: Message, arrived_s: float) -> None:
        name = message.msgname
        if self.is_own(message):
            number = int(message.get_seq())
            if (silent_s := arrived_s - self.received_s) > SILENCE_TIMEOUT_S:
                skipped = (number - self._number - 1) % SEQUENCE_MODULUS
                self._gap = LinkGap(silent_s, number < MAX_RESTART_NUMBER <= skipped)
            self.received_s, self._number = arrived_s, number
            # Commands of another ground station are acknowledged to that one.
            if name == "COMMAND_ACK" and message.target_system in (0, GROUND_SYSTEM):
                self._acks[message.command] = message.result
                sent_s = self._sent_s.pop(message.command, arrived_s)
                self.slowest_s = max(self.slowest_s, arrived_s - sent_s)
            elif name == "PARAM_VALUE":
                self._reported[str(message.param_id)] = _decode_parameter(message)
        self.on_message(message, arrived_s)

    def is_own(self, message: Message) -> bool:
        """Return whether the message is from the autopilot, not a companion or gimbal."""
        return bool(message.get_srcComponent() == self.component)

    def take_gap(self) -> LinkGap | None:
        """Return and clear the last silence of the autopilot that has ended."""
        gap, self._gap = self._gap, None
        return gap

    def _discovery_error(self) -> NoDevice | ProtocolError:
        """Return the error for a link without an autopilot."""
        if self.frames.received:
            return ProtocolError(
                f"{self.address} carries MAVLink, but no autopilot's heartbeat came within "
                f"{DISCOVERY_TIMEOUT_S:g} s; check that the flight controller runs and is not "
                f"behind a router"
            )
        if self.frames.unsigned:
            return ProtocolError(
                f"{self.address} carries MAVLink, but no frame has a signature of this key; check "
                f"key= and the key of the autopilot"
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


def _decode_parameter(message: Message) -> float:
    """Return a parameter's value.

    ArduPilot sends every value as a float. PX4 copies the bits of integers into the float, which
    then is close to zero.
    """
    value = float(message.param_value)
    if message.param_type in INTEGER_TYPES and value != 0.0 and abs(value) < 1e-30:
        return float(struct.unpack("<i", struct.pack("<f", value))[0])
    return value
