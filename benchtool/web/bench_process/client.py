"""The server's end of the bench process: send commands, store the latest events."""

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

SHOWN_EVENTS = 200  # Events of a run that pages show; the run folder has them all

HEARTBEAT_INTERVAL_S = 0.1

SHUTDOWN_TIMEOUT_S = 5.0  # for the bench process to stop motors and close a run


class BenchClient:
    """Send commands to the bench process, and hold its latest snapshots for every page.

    `marks` are the annotations of this connection: time of the stream in s, and text.
    Everything here runs in the page's loop; `start` is called there.
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
        if not self._process.started:
            self._process.start()
        loop = asyncio.get_running_loop()
        threading.Thread(target=self._send_heartbeats, name="heartbeat", daemon=True).start()
        self._listen_to_process(loop)

    def _listen_to_process(self, loop: asyncio.AbstractEventLoop) -> None:
        threading.Thread(
            target=self._listen, args=(self._process, loop), name="bench events", daemon=True
        ).start()

    def send(self, command: messages.Command) -> None:
        """Send a command; the bench process answers with events."""
        # That a process is gone is reported, and another started, where it is listened to.
        self._process.send(pickle.dumps(command))

    def stop(self, who: str) -> None:
        self.send(messages.StopMotors(who))

    def dismiss_alarm(self) -> None:
        """Take somebody's word that the motors stand, and that why the bench is off was read."""
        self.connection = replace(self.connection, unseen="", reason="")

    def close(self) -> None:
        """End the process: it stops the motors and closes its run first."""
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
            # A loop that is closed has no page any more.
            with suppress(RuntimeError):
                loop.call_soon_threadsafe(self._receive, message)
        if not self._closing.is_set():
            loop.call_soon_threadsafe(self._restart)

    def _restart(self) -> None:
        """Start another process for one that ended by itself."""
        reason = (
            "the process that held the bench has ended; its motors were not seen to stand: look, "
            "cut the power if they turn, then connect it anew"
        )
        unseen = reason if self.connection.status == "on" else ""
        session = self.connection.session
        self._process = self._process.successor()
        self._process.start()
        self._listen_to_process(asyncio.get_running_loop())
        self.connection = messages.ConnectionStatus(reason=reason, session=session, unseen=unseen)
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
        elif isinstance(event, messages.RunEvent):
            self.events.append(event.event)
            del self.events[:-SHOWN_EVENTS]
            if event.event.event == ANNOTATION:
                self.marks.append((frame_time_s(self._frame), event.event.text))
        elif isinstance(event, messages.PressEnded):
            self.on_press_ended(event)
        else:
            self.on_notice(event)
