"""One conversation with a GRBL 1.1 stage: lines answered by `ok`, states requested, silences."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from benchtool.bench.identify import mismatch_message, probe_answer
from benchtool.bench.stage import grbl_lines
from benchtool.bench.stage.stage import Pause
from benchtool.bench.transport.transport import SHOWN_BYTES, Transport
from benchtool.core.errors import NoDevice, ProtocolError, StageError

WAKE_S = 5.0  # boards that reset when their port is opened take 1 to 2 s to boot; a margin on that

WAKE_TRY_S = 1.0
ANSWER_S = 2.0  # 95 % of answers come in 13 ms, except while homing; longer is a fault

LISTEN_S = 0.02
AFTER_BANNER_S = 0.1  # the word that G-code is locked follows the banner at once

POLL_S = 0.2
REPORT_INTERVAL_S = 0.05  # while it moves: 5 mm at 100 mm/s
MAX_REACTION_S = 0.1  # interval, answer (95 % in 13 ms) and a read of the bench; assumed
SETTINGS_TRIES = 3
MOST_REPORTS = 40  # the work offset comes in every 10th to 30th report (Grbl 1.1 configuration)


class GrblLink:
    """Talk to a stage.

    Attributes:
        locked: it takes no G-code before it is unlocked or homed.
        homed: it knows where it stands.
        unanswered: a line was sent that has no answer; half of it may wait there for the rest.
    """

    def __init__(self, transport: Transport, clock: Callable[[], float], name: str) -> None:
        self.locked = False
        self.homed = False
        self.unanswered = False
        self.name = name
        self._transport = transport
        self._clock = clock
        self._decoder = grbl_lines.GrblDecoder()
        self._received = b""

    def open(self) -> None:
        """Open the port; nothing is sent yet."""
        self._transport.open()
        self.locked = self.homed = self.unanswered = False

    def close(self) -> None:
        self._transport.close()

    def send(self, data: bytes) -> None:
        self._transport.write(data)

    def wake(self) -> None:
        """Reset the stage until it says its name; name what is there instead."""
        self._received = b""
        deadline_s = self._clock() + WAKE_S
        while self._clock() < deadline_s:
            self._transport.write(grbl_lines.RESET)
            try_s = min(self._clock() + WAKE_TRY_S, deadline_s)
            while self._clock() < try_s:
                if any(isinstance(word, grbl_lines.Banner) for word in self._receive()):
                    self.unanswered = False
                    return
        self._received = self._received or probe_answer(self._transport, self._clock)
        if self._received:
            raise ProtocolError(f"{self.name} {mismatch_message('stage', self._received)}")
        raise NoDevice(
            f"{self.name} did not answer a reset within {WAKE_S:g} s; check its power, port and "
            f"baud rate (GRBL: 115200)"
        )

    def settings(self, pause: Pause) -> grbl_lines.GrblSettings:
        """Return the numbered settings; requested again where noise has spoilt or eaten a line."""
        found: dict[int, float] = {}
        for tries_left in reversed(range(SETTINGS_TRIES)):
            try:
                words = self.order(
                    grbl_lines.SETTINGS, "a question for its settings", ANSWER_S, pause
                )
            except StageError:
                if not tries_left:
                    raise
                continue
            found |= {
                word.number: word.value
                for word in words
                if isinstance(word, grbl_lines.GrblSetting)
            }
            spoilt = any(isinstance(word, grbl_lines.Other) for word in words)
            if not spoilt and found.keys() >= grbl_lines.NEEDED:
                break
        return grbl_lines.GrblSettings(found)

    def order(
        self, line: bytes, what: str, longest_s: float, pause: Pause
    ) -> list[grbl_lines.GrblLine]:
        """Send a line and return all lines until its `ok`, however long it is silent."""
        self._discard(what)
        self.unanswered = True
        self._transport.write(line)
        lines: list[grbl_lines.GrblLine] = []
        deadline_s = self._clock() + longest_s
        while self._clock() < deadline_s:
            pause(LISTEN_S)
            for word in self._receive():
                self._raise_for(word, what)
                if isinstance(word, grbl_lines.Ok):
                    self.unanswered = False
                    return lines
                lines.append(word)
        raise self.given_up(what, longest_s)

    def watched(self, line: bytes, what: str, pause: Pause) -> Iterator[grbl_lines.StatusReport]:
        """Send a line and give every report from then on, asking all the while; never ends.

        A report that was asked for is waited for, not found after the next pause.

        The line's `ok` proves nothing that the reports do not: it may be lost, and noise that
        ends a line twice makes two of them.
        """
        self.unanswered = True
        self._transport.write(line)
        report_s = requested_s = self._clock()
        is_asked = False
        while True:
            now_s = self._clock()
            if now_s - report_s > ANSWER_S:
                self._transport.write(grbl_lines.HOLD)  # it may receive what it cannot answer
                raise self.given_up(what, ANSWER_S)
            since_s = now_s - requested_s
            if since_s >= REPORT_INTERVAL_S:
                requested_s, is_asked = now_s, True
                self._transport.write(grbl_lines.STATUS)
            elif not is_asked or since_s >= LISTEN_S:
                pause(LISTEN_S)
            for word in self._receive(LISTEN_S if is_asked else 1e-3):
                self._raise_for(word, what)
                if isinstance(word, grbl_lines.Ok):
                    self.unanswered = False
                if isinstance(word, grbl_lines.StatusReport):
                    report_s, is_asked = self._clock(), False
                    yield word

    def listen(self, seconds: float, what: str, pause: Pause) -> None:
        """Raise for alarms and restarts that are reported within so long."""
        until_s = self._clock() + seconds
        while self._clock() < until_s:
            pause(LISTEN_S)
            for word in self._receive():
                self._raise_for(word, what)

    def request_report(self, pause: Pause) -> grbl_lines.StatusReport:
        """Return a status report; requested again every `POLL_S`, as a byte may be lost."""
        what = "a question for its state"
        self._discard(what)
        deadline_s = self._clock() + ANSWER_S
        while (requested_s := self._clock()) < deadline_s:
            self._transport.write(grbl_lines.STATUS)
            while self._clock() - requested_s < POLL_S:
                for word in self._receive():
                    self._raise_for(word, what)
                    if isinstance(word, grbl_lines.StatusReport):
                        return word
                pause(LISTEN_S)
        raise self.given_up(what, ANSWER_S)

    def position_mm(self, pause: Pause) -> dict[str, float]:
        """Return the machine position by axis letter; asks until it can be known."""
        for _ in range(MOST_REPORTS):
            place = self.place_mm(self.request_report(pause))
            if place is not None:
                return place
        raise StageError(
            f"{self.name} reports work positions without their offset; set $10=1 (machine "
            f"position) and start again"
        )

    def place_mm(self, report: grbl_lines.StatusReport) -> dict[str, float] | None:
        """Return the machine position in a report by axis letter, None while it cannot be known."""
        place = self._decoder.machine_mm(report)
        return None if place is None else dict(zip("XYZABC", place, strict=False))

    def given_up(self, what: str, silent_s: float) -> StageError:
        """Return the error of a stage that says nothing; where it stands is not known any more."""
        self.homed, self.unanswered = False, True
        return StageError(
            f"{self.name} answered nothing to {what} for {silent_s:.0f} s and is given up; switch "
            f"it off and on, then start again"
        )

    def _discard(self, what: str) -> None:
        """Take what is left of earlier answers, so that it is not taken for that of the next."""
        for word in self._receive(0.0):
            self._raise_for(word, what)

    def _receive(self, timeout_s: float = LISTEN_S) -> list[grbl_lines.GrblLine]:
        data = self._transport.read(timeout_s)
        if len(self._received) < SHOWN_BYTES:
            self._received = (self._received + data)[:SHOWN_BYTES]
        words = self._decoder.feed(data)
        for word in words:
            if isinstance(word, grbl_lines.Banner):
                words += self._after_banner()
                break
        for word in words:
            if isinstance(word, grbl_lines.Note) and word.locked:
                self.locked = True
            elif isinstance(word, grbl_lines.Alarm) and word.loses_position:
                self.homed = False
        return words

    def _after_banner(self) -> list[grbl_lines.GrblLine]:
        """Listen for what follows a banner; without word of a lock there is none."""
        self.locked = False
        until_s = self._clock() + AFTER_BANNER_S
        words: list[grbl_lines.GrblLine] = []
        while self._clock() < until_s:
            words += self._decoder.feed(self._transport.read(LISTEN_S))
        return words

    def _raise_for(self, word: grbl_lines.GrblLine, what: str) -> None:
        """Turn a refusal, an alarm or a restart into an error; the stage is woken from alarms."""
        if isinstance(word, grbl_lines.Error):
            self.unanswered = False
            raise StageError(f"{self.name} refused {what}: {word}")
        if isinstance(word, grbl_lines.Alarm):
            # After a limit it answers nothing until it is reset.
            self.wake()
            raise StageError(f"{self.name} stopped during {what}: {word}")
        if isinstance(word, grbl_lines.StatusReport) and word.state == "Alarm":
            raise StageError(f"{self.name} is locked by an alarm during {what}; home it")
        if isinstance(word, grbl_lines.Banner):
            self.homed = False
            raise StageError(
                f"{self.name} started anew during {what} and lost its position; check its power "
                f"and its emergency stop, then start again"
            )
