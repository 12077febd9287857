"""Host endpoint of the bench protocol: hello, acknowledged commands, heartbeats, messages."""

from __future__ import annotations

from collections.abc import Callable
from math import inf

from benchtool.bench.bench import Readings
from benchtool.bench.identify import mismatch_message
from benchtool.bench.serial import commands as wire
from benchtool.bench.serial import frames
from benchtool.bench.serial.hello import Hello, HelloReader
from benchtool.bench.transport.transport import LinkEndpoint, Transport
from benchtool.core.errors import HostSuspended, LinkLost, NoDevice, PortBusy, ProtocolError

HELLO_TIMEOUT_S = 5.0  # hellos are repeated while a board boots that resets on opening

HELLO_RETRY_INTERVAL_S = 0.25
REPLY_TIMEOUT_S = 0.1  # of one attempt: six latency periods (16 ms) of an FTDI adapter

MAX_ATTEMPTS = 5
HEARTBEAT_S = 0.08  # a third of the 250 ms watchdog: two heartbeats may be lost

# Greatest age of the device time that a command repeats; a fifth of the age at which the device
# rejects it.
MAX_REPLY_AGE_S = 0.1


class CommandChannel(LinkEndpoint):
    """Command channel to a device over a transport."""

    def __init__(
        self,
        transport: Transport,
        address: str,
        clock: Callable[[], float],
        # Called with every block of readings after the hello, also during commands
        on_readings: Callable[[Readings], None] = lambda readings: None,
    ) -> None:
        super().__init__(transport, address, clock)
        self._on_readings = on_readings
        self._decoder = frames.Decoder()
        self._reader = HelloReader()
        self._number = 0
        self._sent_s = 0.0
        self._device_us = 0  # newest device time that was read, wrapped
        self._device_read_s = -inf
        self._events: list[wire.DeviceEvent] = []
        self._replies: dict[int, wire.Reply] = {}
        self._hello: Hello | None = None
        self._opened_s = 0.0

    def open(self) -> Hello:
        """Open the transport and request a hello until a device replies."""
        self._decoder = frames.Decoder()
        self._reader = HelloReader()
        self._number, self._device_read_s = 0, -inf
        self.received = b""
        self._hello, self._opened_s = None, self.clock()
        self.transport.open()
        self.gaps.begin(self.clock())
        self._hello = hello = self._request_hello()
        self._decoder.expect(len(hello.channels), hello.speed)
        self._events = []
        return hello

    def close(self) -> None:
        self._hello = None
        super().close()

    def now_s(self) -> float:
        """Return bench time: wall time multiplied by the speed of the device."""
        speed = self._hello.speed if self._hello else 1.0
        return self._opened_s + (self.clock() - self._opened_s) * speed

    def exchange(
        self, command: wire.Command, attempts: int = MAX_ATTEMPTS, moves: bool = False
    ) -> wire.Reply:
        """Send a command until it is acknowledged; the device executes each number once.

        All attempts are the same line, so the command's age counts from the first.

        Args:
            moves: the command may cause motion; it is not sent after a pause of this computer.

        Raises:
            LinkLost: no reply to any attempt.
            HostSuspended: this computer was paused meanwhile and the command causes motion; or it
                was paused since the previous command, and this one was rejected as late.
        """
        previous_gap_s = self.gaps.longest_s
        self.gaps.begin(self.clock())
        carries_age = not isinstance(command, wire.RequestPlate | wire.StopDevice)
        # After a pause, buffered samples are read with old times. Commands that arm or turn motors
        # keep that age, so that a stop under way outdates them.
        has_stale_time = previous_gap_s > MAX_REPLY_AGE_S and not isinstance(
            command, wire.ArmDevice | wire.SetPwm
        )
        if carries_age and (has_stale_time or self.clock() > self._device_read_s + MAX_REPLY_AGE_S):
            self._transact(wire.RequestPlate(), attempts)  # its reply has the device time
        reply = self._transact(command, attempts, moves)
        if wire.is_too_old(reply.reason) and previous_gap_s > wire.MAX_COMMAND_AGE_S:
            raise HostSuspended(previous_gap_s, wire.MAX_COMMAND_AGE_S)
        return reply

    def _transact(self, command: wire.Command, attempts: int, moves: bool = False) -> wire.Reply:
        if moves:
            self._raise_if_paused()
        number = self._number = self._number + 1
        line = frames.frame_command(number, command, self._device_us)
        self._replies.clear()
        for _ in range(attempts):
            self._send(line)
            reply = self.wait(REPLY_TIMEOUT_S, lambda: self._replies.pop(number, None))
            if moves or (reply is not None and reply.reason.startswith(wire.LATE_REASON)):
                self._raise_if_paused()
            if reply is not None:
                return reply
        text = ",".join(wire.command_fields(command))
        raise LinkLost(
            f"{self.address} did not acknowledge {text!r} in {attempts} attempts of "
            f"{1000.0 * REPLY_TIMEOUT_S:.0f} ms; the device should stop its motors by its "
            f"watchdog; check cable and power, then start again"
        )

    def halt(self) -> None:
        """Send a stop without waiting for its reply, also during an exchange of another thread."""
        self.transport.write(frames.frame_command(0, wire.StopDevice()))

    def _send_due_heartbeat(self, now_s: float) -> None:
        if now_s - self._sent_s >= HEARTBEAT_S:
            self._send(frames.HEARTBEAT)

    def _process(self, data: bytes) -> None:
        readings = self._decoder.feed(data, self.now_s())
        for message in self._decoder.take_messages():
            self._process_message(message)
        if len(readings):
            self._update_device_time(int(readings.device_time_us[-1]) % frames.TIME_MODULUS_US)
        if self._hello is not None:
            self._on_readings(readings)

    def take_events(self) -> list[wire.DeviceEvent]:
        """Return the device's events since the last call, oldest first."""
        events, self._events = self._events, []
        return events

    def _raise_if_paused(self) -> None:
        if (paused_s := self.gaps.longest_s) > wire.MAX_COMMAND_AGE_S:
            raise HostSuspended(paused_s, wire.MAX_COMMAND_AGE_S)

    def _request_hello(self) -> Hello:
        deadline_s = self.clock() + HELLO_TIMEOUT_S
        while self.clock() < deadline_s:
            self._number += 1
            self._send(frames.frame_command(self._number, wire.RequestHello()))
            retry_s = self.clock() + HELLO_RETRY_INTERVAL_S
            is_latest = False
            while not is_latest and (left_s := retry_s - self.clock()) > 0.0:
                self.pump(left_s)
                while self._replies:
                    number, reply = self._replies.popitem()
                    if not reply.ok and number <= self._number:
                        raise ProtocolError(
                            f"{self.address} rejected the hello: {reply.reason}; update its "
                            f"firmware"
                        )
                    # On a slow line this may acknowledge an earlier attempt, which is as good.
                    is_latest = number == self._number
                    if hello := self._reader.hello(reply.fields):
                        if not is_latest:
                            self._device_read_s = -inf  # the last attempt stops the device again
                        return hello
        if not self.received:
            raise NoDevice(
                f"{self.address} is open, but sent nothing for {HELLO_TIMEOUT_S:g} s; check power, "
                f"firmware and baud rate"
            )
        raise ProtocolError(
            f"{self.address} {mismatch_message('bench', self.received, self.address)}"
        )

    def _update_device_time(self, time_us: int) -> None:
        """Store a device time that was read, unless it is older than the stored one."""
        is_first = self._device_read_s == -inf
        if is_first or frames.signed_step(time_us, self._device_us, frames.TIME_MODULUS_US) > 0:
            self._device_us, self._device_read_s = time_us, self.clock()

    def _send(self, data: bytes) -> None:
        self.transport.write(data)
        self._sent_s = self.clock()

    def _process_message(self, message: frames.TextMessage) -> None:
        letter, fields = message.letter, message.fields
        if letter in ("A", "N") and len(fields) >= 2 and fields[0].isdecimal():
            if fields[1].isdecimal() and int(fields[1]) < frames.TIME_MODULUS_US:
                self._update_device_time(int(fields[1]))
            self._replies[int(fields[0])] = (
                wire.Reply(True, fields=fields[2:])
                if letter == "A"
                else wire.Reply(False, ",".join(fields[2:] or fields[1:]))
            )
        elif letter == "H":
            self._reader.take(fields)
        elif letter == "E" and fields:
            event = wire.DeviceEvent(fields[0], ",".join(fields[1:]))
            if event.kind == "busy":
                raise PortBusy(f"{self.address} is in use by {event.text}; end that and try again")
            self._events.append(event)
