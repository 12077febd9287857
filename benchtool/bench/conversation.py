"""The host's end of the wire: hello, numbered commands until acknowledged, heartbeats, news."""

from __future__ import annotations

from collections.abc import Callable

from benchtool.bench.commands import AskHello, Command, Reply, Stop, fields_of
from benchtool.bench.firmware import Event
from benchtool.bench.hello import Hello, hello_from
from benchtool.bench.link import (
    HEARTBEAT,
    SEQUENCE_MODULUS,
    Batch,
    Decoder,
    Message,
    frame_command,
)
from benchtool.bench.strangers import not_a_bench
from benchtool.bench.transport import Transport
from benchtool.errors import LinkLost, NoDevice, PortBusy, ProtocolError

HELLO_S = 5.0
"""How long the hello is repeated: boards that reset when their port is opened boot meanwhile."""

HELLO_TRY_S = 0.25
ANSWER_S = 0.1
"""How long one try of a command waits: six latency periods (16 ms) of an FTDI adapter."""

TRIES = 5
HEARTBEAT_S = 0.08
"""A third of the 250 ms watchdog: two heartbeats may get lost."""

LONGEST_WAIT_S = 0.02
_SHOWN_BYTES = 200


class Conversation:
    """Hold one conversation with a device over a transport.

    Args:
        transport: carries the bytes.
        address: for messages.
        clock: monotonic wall clock in seconds.
        take: is given every batch of samples and the wall time of its arrival, whatever is waited
            for meanwhile.
    """

    def __init__(
        self,
        transport: Transport,
        address: str,
        clock: Callable[[], float],
        take: Callable[[float, Batch], None] = lambda arrived_s, batch: None,
    ) -> None:
        self.transport = transport
        self._address = address
        self._clock = clock
        self._take = take
        self._decoder = Decoder()
        self._number = 0
        self._sent_s = 0.0
        self._events: list[Event] = []
        self._replies: dict[int, Reply] = {}
        self._told: dict[tuple[str, ...], None] = {}
        self._lost = self._corrupt = 0
        self._heard = b""

    def open(self) -> Hello:
        """Open the transport and ask who is there until somebody answers.

        Raises:
            PortBusy, PortDenied, NoDevice: the port cannot be had, or it stays silent.
            ProtocolError: what answers speaks something else.
        """
        self._decoder = Decoder()
        self._number = 0
        self._told, self._heard = {}, b""
        self.transport.open()
        hello = self._ask_hello()
        self._decoder.expect(len(hello.channels))
        self._lost = self._corrupt = 0
        self._events = []
        return hello

    def close(self) -> None:
        """Give the transport back."""
        self.transport.close()

    def exchange(self, command: Command, tries: int = TRIES) -> Reply:
        """Send a command until it is answered; the device carries each number out once.

        Raises:
            LinkLost: no answer to any try.
        """
        number = self._number = self._number % (SEQUENCE_MODULUS - 1) + 1
        self._replies.clear()
        line = frame_command(number, command)
        for _ in range(tries):
            if (reply := self._try(number, line, ANSWER_S)) is not None:
                return reply
        raise LinkLost(
            f"{self._address} did not answer {','.join(fields_of(command))!r} in {tries} tries of "
            f"{1000.0 * ANSWER_S:.0f} ms; the device stops its motors by itself; check cable and "
            f"power, then start again"
        )

    def halt(self) -> None:
        """Send a stop without waiting for its answer; another thread may be in an exchange.

        Its number, 0, is one that `exchange` never takes.

        Raises:
            LinkLost: the other end went away or takes nothing.
        """
        self.transport.write(frame_command(0, Stop()))

    def pump(self, timeout_s: float) -> bool:
        """Send a heartbeat when one is due and take what arrives within a short wait.

        Returns:
            whether anything arrived.
        """
        now_s = self._clock()
        if now_s - self._sent_s >= HEARTBEAT_S:
            self._send(HEARTBEAT)
        data = self.transport.read(min(timeout_s, LONGEST_WAIT_S))
        if not data:
            return False
        if len(self._heard) < _SHOWN_BYTES:
            self._heard = (self._heard + data)[:_SHOWN_BYTES]
        batch = self._decoder.feed(data)
        self._lost += batch.lost
        self._corrupt += batch.corrupt
        arrived_s = self._clock()
        for message in batch.messages:
            self._sort(message)
        if len(batch.device_time_us):
            self._take(arrived_s, batch)
        return True

    def take_events(self) -> list[Event]:
        """Return the device's news since the last call, oldest first."""
        events, self._events = self._events, []
        return events

    def take_losses(self) -> tuple[int, int]:
        """Return lost samples and corrupt lines since the last call."""
        losses = self._lost, self._corrupt
        self._lost = self._corrupt = 0
        return losses

    def _try(self, number: int, line: bytes, wait_s: float) -> Reply | None:
        self._send(line)
        deadline_s = self._clock() + wait_s
        while True:
            if number in self._replies:
                return self._replies.pop(number)
            left_s = deadline_s - self._clock()
            if left_s <= 0.0:
                return None
            self.pump(left_s)

    def _ask_hello(self) -> Hello:
        deadline_s = self._clock() + HELLO_S
        while self._clock() < deadline_s:
            self._number += 1
            reply = self._try(self._number, frame_command(self._number, AskHello()), HELLO_TRY_S)
            if reply is None:
                continue
            if not reply.ok:
                raise ProtocolError(
                    f"{self._address} refused the hello: {reply.reason}; update its firmware"
                )
            # Lines that got lost on the way show as a count that is short: ask again.
            if reply.fields[:1] == (str(len(self._told)),):
                return hello_from(self._told)
        if not self._heard:
            raise NoDevice(
                f"{self._address} is open, but nothing answered for {HELLO_S:g} s; check power, "
                f"firmware and baud rate (`benchtool doctor` tries each cause)"
            )
        raise ProtocolError(f"{self._address} {not_a_bench(self._heard, self._address)}")

    def _send(self, data: bytes) -> None:
        self.transport.write(data)
        self._sent_s = self._clock()

    def _sort(self, message: Message) -> None:
        letter, fields = message.letter, message.fields
        if letter == "A" and len(fields) >= 2 and fields[0].isdecimal():
            self._replies[int(fields[0])] = Reply(True, fields=fields[2:])
        elif letter == "N" and len(fields) >= 2 and fields[0].isdecimal():
            self._replies[int(fields[0])] = Reply(False, ",".join(fields[1:]))
        elif letter == "H":
            self._told[fields] = None
        elif letter == "E" and fields:
            event = Event(fields[0], ",".join(fields[1:]))
            if event.kind == "busy":
                raise PortBusy(f"{self._address} is in use by {event.text}; end that and try again")
            self._events.append(event)
