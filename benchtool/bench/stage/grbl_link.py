"""Command channel to a GRBL 1.1 stage: acknowledged lines, state polling, timeouts."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from benchtool.bench.identify import mismatch_message, probe_answer
from benchtool.bench.stage import grbl_lines
from benchtool.bench.stage.stage import Pause
from benchtool.bench.transport.transport import MAX_STORED_BYTES, Transport
from benchtool.core.errors import NoDevice, ProtocolError, StageError

RESET_TIMEOUT_S = 5.0  # boards that reset when their port is opened boot in 1 to 2 s; a margin
RESET_RETRY_INTERVAL_S = 1.0
REPLY_TIMEOUT_S = 2.0  # 95 % of replies come in 13 ms, except while homing; longer is a fault

LISTEN_S = 0.02
AFTER_BANNER_S = 0.1  # the message that G-code is locked follows the banner immediately

POLL_INTERVAL_S = 0.2
REPORT_INTERVAL_S = 0.05  # while it moves: 5 mm at 100 mm/s
MAX_REACTION_S = 0.1  # interval, reply (95 % in 13 ms) and a read of the bench; assumed
SETTINGS_ATTEMPTS = 3
MAX_REPORTS = 40  # the work offset comes in every 10th to 30th report (Grbl 1.1 configuration)


class GrblLink:
    """Command channel to a stage."""

    def __init__(self, transport: Transport, clock: Callable[[], float], name: str) -> None:
        self.is_locked = False  # G-code is rejected until the stage is unlocked or homed
        self.is_homed = False  # the machine position is known
        # A line has no acknowledgement; half of it may be buffered in the stage
        self.is_unacknowledged = False
        self.name = name
        self._transport = transport
        self._clock = clock
        self._decoder = grbl_lines.GrblDecoder()
        self._received = b""

    def open(self) -> None:
        """Open the port without sending anything."""
        self._transport.open()
        self.is_locked = self.is_homed = self.is_unacknowledged = False

    def close(self) -> None:
        self._transport.close()

    def send(self, data: bytes) -> None:
        self._transport.write(data)

    def reset(self) -> None:
        """Reset the stage until it sends its name; identify an unexpected device."""
        self._received = b""
        deadline_s = self._clock() + RESET_TIMEOUT_S
        while self._clock() < deadline_s:
            self._transport.write(grbl_lines.RESET)
            retry_s = min(self._clock() + RESET_RETRY_INTERVAL_S, deadline_s)
            while self._clock() < retry_s:
                if any(isinstance(message, grbl_lines.Banner) for message in self._receive()):
                    self.is_unacknowledged = False
                    return
        self._received = self._received or probe_answer(self._transport, self._clock)
        if self._received:
            raise ProtocolError(f"{self.name} {mismatch_message('stage', self._received)}")
        raise NoDevice(
            f"{self.name} did not reply to a reset within {RESET_TIMEOUT_S:g} s; check its power, "
            f"port and baud rate (GRBL: 115200)"
        )

    def read_settings(self, pause: Pause) -> grbl_lines.GrblSettings:
        """Return the numbered settings; request them again if a line was lost or damaged."""
        values: dict[int, float] = {}
        for attempts_left in reversed(range(SETTINGS_ATTEMPTS)):
            try:
                messages = self.send_command(
                    grbl_lines.SETTINGS, "the request for its settings", REPLY_TIMEOUT_S, pause
                )
            except StageError:
                if not attempts_left:
                    raise
                continue
            values |= {
                message.number: message.value
                for message in messages
                if isinstance(message, grbl_lines.GrblSetting)
            }
            is_damaged = any(isinstance(message, grbl_lines.UnknownLine) for message in messages)
            if not is_damaged and values.keys() >= grbl_lines.REQUIRED_SETTINGS:
                break
        return grbl_lines.GrblSettings(values)

    def send_command(
        self, line: bytes, action: str, timeout_s: float, pause: Pause
    ) -> list[grbl_lines.GrblLine]:
        """Send a line and return all lines up to its `ok`, perhaps after a long action."""
        self._discard(action)
        self.is_unacknowledged = True
        self._transport.write(line)
        lines: list[grbl_lines.GrblLine] = []
        deadline_s = self._clock() + timeout_s
        while self._clock() < deadline_s:
            pause(LISTEN_S)
            for message in self._receive():
                self._raise_if_error(message, action)
                if isinstance(message, grbl_lines.Ok):
                    self.is_unacknowledged = False
                    return lines
                lines.append(message)
        raise self.timeout_error(action, timeout_s)

    def reports(self, line: bytes, action: str, pause: Pause) -> Iterator[grbl_lines.StatusReport]:
        """Send a line and yield every report from then on, while polling; never ends.

        A requested report is awaited without a pause. The line's `ok` adds nothing to the reports:
        it may be lost, and noise that ends a line twice causes two of them.
        """
        self.is_unacknowledged = True
        self._transport.write(line)
        report_s = requested_s = self._clock()
        is_pending = False
        while True:
            now_s = self._clock()
            if now_s - report_s > REPLY_TIMEOUT_S:
                self._transport.write(grbl_lines.HOLD)  # it may receive without replying
                raise self.timeout_error(action, REPLY_TIMEOUT_S)
            since_s = now_s - requested_s
            if since_s >= REPORT_INTERVAL_S:
                requested_s, is_pending = now_s, True
                self._transport.write(grbl_lines.STATUS)
            elif not is_pending or since_s >= LISTEN_S:
                pause(LISTEN_S)
            for message in self._receive(LISTEN_S if is_pending else 1e-3):
                self._raise_if_error(message, action)
                if isinstance(message, grbl_lines.Ok):
                    self.is_unacknowledged = False
                if isinstance(message, grbl_lines.StatusReport):
                    report_s, is_pending = self._clock(), False
                    yield message

    def listen(self, duration_s: float, action: str, pause: Pause) -> None:
        """Raise for alarms and restarts that are reported within this time."""
        deadline_s = self._clock() + duration_s
        while self._clock() < deadline_s:
            pause(LISTEN_S)
            for message in self._receive():
                self._raise_if_error(message, action)

    def request_report(self, pause: Pause) -> grbl_lines.StatusReport:
        """Return a status report; repeat the request every interval, because a byte may be lost."""
        action = "the request for its state"
        self._discard(action)
        deadline_s = self._clock() + REPLY_TIMEOUT_S
        while (requested_s := self._clock()) < deadline_s:
            self._transport.write(grbl_lines.STATUS)
            while self._clock() - requested_s < POLL_INTERVAL_S:
                for message in self._receive():
                    self._raise_if_error(message, action)
                    if isinstance(message, grbl_lines.StatusReport):
                        return message
                pause(LISTEN_S)
        raise self.timeout_error(action, REPLY_TIMEOUT_S)

    def position_mm(self, pause: Pause) -> dict[str, float]:
        """Return the machine position by axis letter; poll until it is known."""
        for _ in range(MAX_REPORTS):
            position_mm = self.reported_mm(self.request_report(pause))
            if position_mm is not None:
                return position_mm
        raise StageError(
            f"{self.name} reports work positions without their offset; set $10=1 (machine "
            f"position) and start again"
        )

    def reported_mm(self, report: grbl_lines.StatusReport) -> dict[str, float] | None:
        """Return the machine position in a report by axis letter, or None if it is unknown."""
        position_mm = self._decoder.machine_mm(report)
        return None if position_mm is None else dict(zip("XYZABC", position_mm, strict=False))

    def timeout_error(self, action: str, timeout_s: float) -> StageError:
        """Return the timeout error of a silent stage, whose position is unknown from now on."""
        self.is_homed, self.is_unacknowledged = False, True
        return StageError(
            f"{self.name} did not reply to {action} for {timeout_s:.0f} s; switch it off and on, "
            f"then start again"
        )

    def _discard(self, action: str) -> None:
        """Read pending lines, so that none is mistaken for the reply to the next command."""
        for message in self._receive(0.0):
            self._raise_if_error(message, action)

    def _receive(self, timeout_s: float = LISTEN_S) -> list[grbl_lines.GrblLine]:
        data = self._transport.read(timeout_s)
        if len(self._received) < MAX_STORED_BYTES:
            self._received = (self._received + data)[:MAX_STORED_BYTES]
        messages = self._decoder.feed(data)
        for message in messages:
            if isinstance(message, grbl_lines.Banner):
                messages += self._read_after_banner()
                break
        for message in messages:
            if isinstance(message, grbl_lines.FeedbackMessage) and message.is_locked_notice:
                self.is_locked = True
            elif isinstance(message, grbl_lines.Alarm) and message.loses_position:
                self.is_homed = False
        return messages

    def _read_after_banner(self) -> list[grbl_lines.GrblLine]:
        """Read the lines after a banner; without a lock message the stage is unlocked."""
        self.is_locked = False
        deadline_s = self._clock() + AFTER_BANNER_S
        messages: list[grbl_lines.GrblLine] = []
        while self._clock() < deadline_s:
            messages += self._decoder.feed(self._transport.read(LISTEN_S))
        return messages

    def _raise_if_error(self, message: grbl_lines.GrblLine, action: str) -> None:
        """Raise for a rejection, an alarm or a restart; an alarm resets the stage."""
        if isinstance(message, grbl_lines.Error):
            self.is_unacknowledged = False
            raise StageError(f"{self.name} rejected {action}: {message}")
        if isinstance(message, grbl_lines.Alarm):
            # After a limit alarm it replies to nothing before a reset.
            self.reset()
            raise StageError(f"{self.name} stopped during {action}: {message}")
        if isinstance(message, grbl_lines.StatusReport) and message.state == "Alarm":
            raise StageError(f"{self.name} is locked by an alarm during {action}; home it")
        if isinstance(message, grbl_lines.Banner):
            self.is_homed = False
            raise StageError(
                f"{self.name} restarted during {action} and lost its position; check its power and "
                f"its emergency stop, then start again"
            )
