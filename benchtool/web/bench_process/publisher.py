"""Publish events to the page, never waiting for it: a page that hangs must not hold the bench."""

from __future__ import annotations

import pickle
import threading
from collections import deque
from multiprocessing.connection import Connection as Pipe

from benchtool.web.bench_process.events import BenchEvent
from benchtool.web.bench_process.frame import merged

FRAME, EVENT = b"F", b"E"


class EventPublisher:
    """Queue what is to be sent; a thread of its own sends it.

    Frames that wait are joined into one, so that the newest is never behind and no extreme lost.
    """

    def __init__(self, pipe: Pipe) -> None:
        self._pipe = pipe
        self._ready = threading.Condition()
        self._events: deque[BenchEvent] = deque()
        self._frame: bytes | None = None
        self._closing = False
        self._thread = threading.Thread(target=self._send_all, name="publisher", daemon=True)
        self._thread.start()

    def publish(self, event: BenchEvent) -> None:
        """Send an event; all of them arrive, in order."""
        with self._ready:
            self._events.append(event)
            self._ready.notify()

    def publish_frame(self, frame: bytes) -> None:
        """Send a frame."""
        with self._ready:
            self._frame = frame if self._frame is None else merged(self._frame, frame)
            self._ready.notify()

    def close(self, patience_s: float = 1.0) -> None:
        """Send what waits and end; a page that takes nothing is waited for only so long."""
        with self._ready:
            self._closing = True
            self._ready.notify()
        self._thread.join(patience_s)

    def _send_all(self) -> None:
        while True:
            with self._ready:
                while not (self._events or self._frame or self._closing):
                    self._ready.wait()
                events, self._events = list(self._events), deque()
                frame, self._frame = self._frame, None
                closing = self._closing
            try:
                for event in events:
                    self._pipe.send_bytes(EVENT + pickle.dumps(event))
                if frame is not None:
                    self._pipe.send_bytes(FRAME + frame)
            except OSError:
                return
            if closing:
                return
