"""Client of the bench process: sends commands and stores the latest events."""

from __future__ import annotations

import asyncio
import pickle
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace

from benchtool.data.run.append import ANNOTATION, Event
from benchtool.web.bench_process import messages
from benchtool.web.bench_process.publisher import FRAME, frame_time_s
from benchtool.web.bench_process.spawn import ProcessHandle

MAX_EVENTS = 200  # events of a run sent to pages; the run folder has all; assumed
HEARTBEAT_INTERVAL_S = 0.1
SHUTDOWN_TIMEOUT_S = 5.0  # for the bench process to stop motors and close a run


class BenchClient:
    """Connection to the bench process with its latest events; all methods run in the event loop.

    `marks` are the annotations of this connection: stream time in s and text.
    """

    def __init__(self, process: ProcessHandle | None = None) -> None:
        self.connection = messages.ConnectionStatus()
        self.live = messages.LiveStatus()
        self.sweep = messages.SweepStatus()
        self.events: list[Event] = []
        self.marks: list[tuple[float, str]] = []
        self.on_notice: Callable[[messages.Notice], None] = lambda notice: None
        self.on_alarm: Callable[[str], None] = lambda text: None
        self.on_press_ended: Callable[[messages.PressEnded], None] = lambda ended: None
        self.on_frame: Callable[[bytes], None] = lambda frame: None
        self.page_problem: Callable[[], str] = lambda: ""
        self._frame = b""
        self._process = process or ProcessHandle()
        self._closing = threading.Event()

    def start(self) -> None:
        self._start_process()
        threading.Thread(target=self._send_heartbeats, name="heartbeat", daemon=True).start()

    def _start_process(self) -> None:
        self._process.start()
        arguments = self._process, asyncio.get_running_loop()
        threading.Thread(
            target=self._listen, args=arguments, name="bench events", daemon=True
        ).start()

    def send(self, command: messages.Command) -> None:
        """Send a command; the bench process responds with events."""
        # A missing process is reported and replaced by the listener thread.
        self._process.send(pickle.dumps(command))

    def dismiss_alarm(self) -> None:
        """Clear the standstill warning and the disconnect reason after a user's confirmation."""
        self.connection = replace(self.connection, standstill_problem="", reason="")

    def close(self) -> None:
        """End the process; it first stops the motors and closes its run."""
        self._closing.set()
        self.send(messages.Shutdown())
        self._process.end(SHUTDOWN_TIMEOUT_S)

    def _send_heartbeats(self) -> None:
        while not self._closing.wait(HEARTBEAT_INTERVAL_S):
            self.send(messages.ServerHeartbeat(self.page_problem()))

    def _listen(self, process: ProcessHandle, loop: asyncio.AbstractEventLoop) -> None:
        while True:
            try:
                message = process.receive()
            except (EOFError, OSError):
                break
            # A closed loop has no pages left.
            with suppress(RuntimeError):
                loop.call_soon_threadsafe(self._receive, message)
        if not self._closing.is_set():
            loop.call_soon_threadsafe(self._restart)

    def _restart(self) -> None:
        """Replace a process that ended unexpectedly."""
        reason = (
            "the bench process ended unexpectedly, standstill is not confirmed; look at the "
            "motors, cut the power if they turn, then reconnect"
        )
        problem = reason if self.connection.status == "on" else ""
        session = self.connection.session
        self._process = ProcessHandle(self._process.stop_endpoint)
        self._start_process()
        self.connection = messages.ConnectionStatus(
            reason=reason, session=session, standstill_problem=problem
        )
        self.live = messages.LiveStatus()
        if self.sweep.active:
            self.sweep = replace(self.sweep, status="stopped", reason=reason)
        self.on_alarm(reason)

    def _receive(self, message: bytes) -> None:
        if message[:1] == FRAME:
            self._frame = message[1:]
            self.on_frame(self._frame)
            return
        event: messages.BenchEvent = pickle.loads(message[1:])
        if isinstance(event, messages.ConnectionStatus):
            if event.session != self.connection.session:
                self.marks.clear()
            self.connection = event
            if event.reason:
                self.on_alarm(event.reason)
            if event.status != "on":
                self.live = messages.LiveStatus()
        elif isinstance(event, messages.LiveStatus):
            self.live = event
        elif isinstance(event, messages.SweepStatus):
            if event.run != self.sweep.run:
                self.events.clear()
            self.sweep = event
        elif isinstance(event, Event):
            self.events.append(event)
            del self.events[:-MAX_EVENTS]
            if event.event == ANNOTATION:
                self.marks.append((frame_time_s(self._frame), event.text))
        elif isinstance(event, messages.PressEnded):
            self.on_press_ended(event)
        else:
            self.on_notice(event)
