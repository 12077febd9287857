"""The host's end of the bridge: who is there, words until answered, the pulse as heartbeat."""

from __future__ import annotations

from collections.abc import Callable

from benchtool.bench.identify import mismatch
from benchtool.bench.rcbenchmark.lines import (
    BridgeDecoder,
    BridgeHello,
    BridgeLine,
    pulse_text,
)
from benchtool.bench.transport.transport import LinkEnd, Transport
from benchtool.core.errors import CommandRefused, LinkLost, NoDevice, ProtocolError

HELLO_S = 5.0
HELLO_TRY_S = 0.25
ANSWER_S = 0.15
"""How long one try of a word waits: GUI and script hand it on several times."""

TRIES = 5
HEARTBEAT_S = 0.08
"""A third of the script's 250 ms: two heartbeats may get lost."""

WRITE_IT = "write it with benchtool bench bridge and run it in the GUI"


class BridgeLink(LinkEnd):
    """Hold one conversation with the bridge script."""

    def __init__(self, transport: Transport, address: str, clock: Callable[[], float]) -> None:
        super().__init__(transport, address, clock)
        self.received_s = 0.0
        self._begin()

    def _begin(self) -> None:
        self.decoder = BridgeDecoder()
        self._answers: dict[bytes, BridgeLine] = {}
        self._lines: list[BridgeLine] = []
        self._sent_s = -HEARTBEAT_S
        self._low = self._pulse = b""
        self.received = b""

    def open(self) -> BridgeHello:
        """Open the transport and ask who is there until the script answers.

        Raises:
            PortBusy, PortDenied, NoDevice: the port cannot be had, or it stays silent.
            ProtocolError: what answers is not the bridge script.
        """
        self._begin()
        self.transport.open()
        deadline_s = self.clock() + HELLO_S
        while self.clock() < deadline_s:
            answer = self._try(b"hello", HELLO_TRY_S)
            hello = answer.entry if answer is not None else None
            if isinstance(hello, BridgeHello):
                self.decoder.speed = hello.speed
                self._low = self._pulse = pulse_text(hello.low_us)
                self.received_s = self.clock()
                return hello
        raise self._silence()

    def order(self, word: bytes, longest_s: float = TRIES * ANSWER_S) -> BridgeLine:
        """Say a word until it is answered; the script may carry it out more than once."""
        if word[:1].isdigit() or word == b"stop":
            # From here on the heartbeat says this; after a stop it says nothing that turns.
            before, self._pulse = self._pulse, self._low if word == b"stop" else word
        else:
            before = self._pulse
        deadline_s = self.clock() + longest_s
        while (left_s := deadline_s - self.clock()) > 0.0:
            answer = self._try(word, min(left_s, ANSWER_S if longest_s < 2.0 else 1.0))
            if answer is None:
                continue
            if refused := answer.entry.refused:
                self._pulse = before
                raise CommandRefused(word.decode(), refused)
            return answer
        raise LinkLost(
            f"{self.address} did not answer {word.decode()!r} within {longest_s:g} s; the script "
            f"should stop the motor unless the GUI has gone as well; look at both, then start "
            f"the script again"
        )

    def pump(self, timeout_s: float) -> bool:
        if self._pulse and self.clock() - self._sent_s >= HEARTBEAT_S:
            self._send(self._pulse)
        data = self.take(timeout_s)
        for line in self.decoder.feed(data):
            self.received_s = self.clock()
            if line.entry.to:
                self._answers[line.entry.to.encode("latin-1", "replace")] = line
            self._lines.append(line)
        return bool(data)

    def take_lines(self) -> list[BridgeLine]:
        """Return the script's lines since the last call, oldest first."""
        lines, self._lines = self._lines, []
        return lines

    def _try(self, word: bytes, wait_s: float) -> BridgeLine | None:
        self._answers.pop(word, None)
        self._send(word)
        return self.wait(wait_s, lambda: self._answers.pop(word, None))

    def _send(self, word: bytes) -> None:
        self.transport.write(word)
        self._sent_s = self.clock()

    def _silence(self) -> NoDevice | ProtocolError:
        if self.decoder.foreign:
            return ProtocolError(
                f"{self.address} sends readings, but not through benchtool's bridge script: the "
                f"script that runs there stops no motor when its host dies; {WRITE_IT}"
            )
        if not self.received:
            return NoDevice(
                f"nothing came from {self.address} for {HELLO_S:g} s; start the bridge script in "
                f"the GUI ({WRITE_IT}), and check that the ports at its head are those of this "
                f"address"
            )
        return ProtocolError(f"{self.address} {mismatch('bridge', self.received)}")
