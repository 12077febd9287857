"""The host's end of the wire: hello, numbered commands until acknowledged, heartbeats, messages."""

from __future__ import annotations

from collections.abc import Callable
from math import inf

from benchtool.bench.bench import Readings
from benchtool.bench.clocks import HostGapDetector
from benchtool.bench.identify import mismatch_message
from benchtool.bench.serial import commands as wire
from benchtool.bench.serial import frames
from benchtool.bench.serial.hello import Hello, HelloReader
from benchtool.bench.transport.transport import LinkEndpoint, Transport
from benchtool.core.errors import HostSuspended, LinkLost, NoDevice, PortBusy, ProtocolError

HELLO_S = 5.0  # the hello is repeated: boards that reset when opened boot meanwhile

HELLO_RETRY_INTERVAL_S = 0.25
REPLY_TIMEOUT_S = 0.1  # one try of a command: six latency periods (16 ms) of an FTDI adapter

MAX_ATTEMPTS = 5
HEARTBEAT_S = 0.08  # A third of the 250 ms watchdog: two heartbeats may get lost

MAX_REPLY_AGE_S = 0.1
"""An order repeats a device time that was read no longer ago; a fifth of the age at which the
device refuses it."""


class CommandChannel(LinkEndpoint):
    """Hold one conversation with a device over a transport.

    Args:
        take: is given every block of readings from the hello on, whatever is waited for meanwhile.
    """

    def __init__(
        self,
        transport: Transport,
        address: str,
        clock: Callable[[], float],
        take: Callable[[Readings], None] = lambda readings: None,
    ) -> None:
        super().__init__(transport, address, clock)
        self._take = take
        self._decoder = frames.Decoder()
        self._reader = HelloReader()
        self._number = 0
        self._sent_s = 0.0
        self._device_us = 0  # newest device time that was read, wrapped
        self._device_read_s = -inf
        self._events: list[wire.DeviceEvent] = []
        self._replies: dict[int, wire.Reply] = {}
        self._gaps = HostGapDetector()
        self._hello: Hello | None = None
        self._opened_s = 0.0

    def open(self) -> Hello:
        """Open the transport and ask who is there until somebody answers.

        Raises:
            PortBusy, PortDenied, NoDevice: the port cannot be had, or it stays silent.
            ProtocolError: what answers speaks something else.
        """
        self._decoder = frames.Decoder()
        self._reader = HelloReader()
        self._number, self._device_read_s = 0, -inf
        self.received = b""
        self._hello, self._opened_s = None, self.clock()
        self.transport.open()
        self._gaps.begin(self.clock())
        self._hello = hello = self._request_hello()
        self._decoder.expect(len(hello.channels), hello.speed)
        self._events = []
        return hello

    def close(self) -> None:
        self._hello = None
        super().close()

    def now_s(self) -> float:
        """Return the device's pace on the host's clock: wall time, multiplied by its speed."""
        speed = self._hello.speed if self._hello else 1.0
        return self._opened_s + (self.clock() - self._opened_s) * speed

    def exchange(
        self, command: wire.Command, tries: int = MAX_ATTEMPTS, moves: bool = False
    ) -> wire.Reply:
        """Send a command until it is answered; the device carries each number out once.

        All tries are the same line: the age of an order is counted from the first.

        Args:
            moves: whether something may move by it: then it is not sent after a pause of this
                computer.

        Raises:
            LinkLost: no answer to any try.
            HostSuspended: this computer stood still meanwhile, and the order moves something; or it
                did so since the order before, and this one was refused as late.
        """
        before_s = self._gaps.longest_s
        self._gaps.begin(self.clock())
        aged = not isinstance(command, wire.RequestPlate | wire.StopDevice)
        # After a pause, samples that waited in a buffer are read with old times. Orders to arm and
        # to turn stay that old, so that a stop on the way outdates them.
        paused = before_s > MAX_REPLY_AGE_S and not isinstance(
            command, wire.ArmDevice | wire.SetPwm
        )
        if aged and (paused or self.clock() > self._device_read_s + MAX_REPLY_AGE_S):
            self._converse(wire.RequestPlate(), tries)  # Its answer brings the device's time.
        reply = self._converse(command, tries, moves)
        if wire.is_too_old(reply.reason) and before_s > wire.MAX_COMMAND_AGE_S:
            raise HostSuspended(before_s, wire.MAX_COMMAND_AGE_S)
        return reply

    def _converse(self, command: wire.Command, tries: int, moves: bool = False) -> wire.Reply:
        if moves:
            self._raise_if_paused()
        number = self._number = self._number + 1
        line = frames.frame_command(number, command, self._device_us)
        self._replies.clear()
        for _ in range(tries):
            self._send(line)
            reply = self.wait(REPLY_TIMEOUT_S, lambda: self._replies.pop(number, None))
            if moves or (reply is not None and reply.reason.startswith(wire.LATE_REASON)):
                self._raise_if_paused()
            if reply is not None:
                return reply
        said = ",".join(wire.command_fields(command))
        raise LinkLost(
            f"{self.address} did not answer {said!r} in {tries} tries of "
            f"{1000.0 * REPLY_TIMEOUT_S:.0f} ms; the device should stop its motors by its "
            f"watchdog; check cable and power, then start again"
        )

    def halt(self) -> None:
        """Send a stop without waiting for its answer; another thread may be in an exchange."""
        self.transport.write(frames.frame_command(0, wire.StopDevice()))

    def pump(self, timeout_s: float) -> bool:
        now_s = self.clock()
        self._gaps.note(now_s)
        if now_s - self._sent_s >= HEARTBEAT_S:
            self._send(frames.HEARTBEAT)
        data = self.take(timeout_s)
        self._gaps.note(self.clock())
        if not data:
            return False
        readings = self._decoder.feed(data, self.now_s())
        for message in self._decoder.take_messages():
            self._sort(message)
        if len(readings):
            self._note_time(str(int(readings.device_time_us[-1]) % frames.TIME_MODULUS_US))
        if self._hello is not None:
            self._take(readings)
        return True

    def take_events(self) -> list[wire.DeviceEvent]:
        """Return the device's events since the last call, oldest first."""
        events, self._events = self._events, []
        return events

    def _raise_if_paused(self) -> None:
        if (paused_s := self._gaps.longest_s) > wire.MAX_COMMAND_AGE_S:
            raise HostSuspended(paused_s, wire.MAX_COMMAND_AGE_S)

    def _request_hello(self) -> Hello:
        deadline_s = self.clock() + HELLO_S
        while self.clock() < deadline_s:
            self._number += 1
            self._send(frames.frame_command(self._number, wire.RequestHello()))
            try_s = self.clock() + HELLO_RETRY_INTERVAL_S
            answered = False
            while not answered and (left_s := try_s - self.clock()) > 0.0:
                self.pump(left_s)
                while self._replies:
                    number, reply = self._replies.popitem()
                    if not reply.ok and number <= self._number:
                        raise ProtocolError(
                            f"{self.address} refused the hello: {reply.reason}; update its firmware"
                        )
                    # On a slow line this answers an earlier try, which is as good.
                    answered = number == self._number
                    if hello := self._reader.hello(reply.fields):
                        if not answered:
                            self._device_read_s = -inf  # The next try stops the device once more.
                        return hello
        if not self.received:
            raise NoDevice(
                f"{self.address} is open, but nothing answered for {HELLO_S:g} s; check power, "
                f"firmware and baud rate"
            )
        raise ProtocolError(
            f"{self.address} {mismatch_message('bench', self.received, self.address)}"
        )

    def _note_time(self, text: str) -> None:
        """Note a device time that was read, unless it is older than what is known."""
        if not (text.isdecimal() and int(text) < frames.TIME_MODULUS_US):
            return
        first = self._device_read_s == -inf
        if first or frames.signed_step(int(text), self._device_us, frames.TIME_MODULUS_US) > 0:
            self._device_us, self._device_read_s = int(text), self.clock()

    def _send(self, data: bytes) -> None:
        self.transport.write(data)
        self._sent_s = self.clock()

    def _sort(self, message: frames.TextMessage) -> None:
        letter, fields = message.letter, message.fields
        if letter == "A" and len(fields) >= 2 and fields[0].isdecimal():
            self._note_time(fields[1])
            self._replies[int(fields[0])] = wire.Reply(True, fields=fields[2:])
        elif letter == "N" and len(fields) >= 2 and fields[0].isdecimal():
            self._note_time(fields[1])
            self._replies[int(fields[0])] = wire.Reply(False, ",".join(fields[2:] or fields[1:]))
        elif letter == "H":
            self._reader.take(fields)
        elif letter == "E" and fields:
            event = wire.DeviceEvent(fields[0], ",".join(fields[1:]))
            if event.kind == "busy":
                raise PortBusy(f"{self.address} is in use by {event.text}; end that and try again")
            self._events.append(event)
