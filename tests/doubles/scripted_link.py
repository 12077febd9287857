"""A transport that plays one exact conversation: bytes expected, bytes prepared, nothing else."""

from __future__ import annotations

from dataclasses import dataclass

from benchtool.core.errors import LinkError


@dataclass(frozen=True, slots=True)
class Turn:
    """Expect the host to send `sent`, then let it read `answer` in that many bytes at a time."""

    sent: bytes
    answer: bytes = b""
    piece: int = 1 << 20


class ScriptedLink:
    """Carry a prepared conversation on a clock of its own.

    Waiting costs no time: a read without an answer moves the clock by its time-out, one with an
    answer by a millisecond.

    `write_after_end` is what a write raises when the conversation is over, instead of a failure.

    Args:
        turns: in order; a host that sends anything else fails the test at once.
        baud: what the port was opened with.
        refuses: what `open` raises.
        then: what a read raises when the conversation is over.
    """

    def __init__(
        self,
        *turns: Turn,
        baud: int | None = None,
        refuses: LinkError | None = None,
        then: LinkError | None = None,
    ) -> None:
        self.now_s = 100.0
        self.active = 0
        self.closed = 0
        self.write_after_end: LinkError | None = None
        self._turns = list(turns)
        self._answer = b""
        self._piece = 1
        self._baud = baud
        self._refuses = refuses
        self._then = then

    @property
    def baud(self) -> int | None:
        return self._baud

    def clock(self) -> float:
        """Return the conversation's time in seconds."""
        return self.now_s

    def pause(self, duration_s: float) -> None:
        """Let time pass."""
        self.now_s += duration_s

    def open(self) -> None:
        if self._refuses is not None:
            raise self._refuses
        self.active += 1

    def read(self, timeout_s: float) -> bytes:
        if not self._answer:
            if self._then is not None and not self._turns:
                raise self._then
            self.now_s += max(timeout_s, 1e-3)
            return b""
        data, self._answer = self._answer[: self._piece], self._answer[self._piece :]
        self.now_s += 1e-3
        return data

    def write(self, data: bytes) -> None:
        if self.write_after_end is not None and not self._turns:
            raise self.write_after_end
        assert self._turns, f"the host sent {data!r} after the end of the conversation"
        turn = self._turns.pop(0)
        assert data == turn.sent, f"the host sent {data!r} instead of {turn.sent!r}"
        self._answer += turn.answer
        self._piece = turn.piece

    def close(self) -> None:
        self.closed += 1

    def check_finished(self) -> None:
        """Fail unless everything was said and read."""
        assert not self._turns, f"the host never sent {self._turns[0].sent!r}"
        assert not self._answer, f"the host never read {self._answer!r}"


class Talker(ScriptedLink):
    """A port on which somebody says the same at every read, or nothing, and listens to nobody."""

    def __init__(self, says: bytes = b"") -> None:
        super().__init__()
        self._says = says

    def read(self, timeout_s: float) -> bytes:
        self.now_s += max(timeout_s, 1e-3)
        return self._says

    def write(self, data: bytes) -> None:
        """Pass it over."""
