"""Send news to the page without ever waiting for it: a page that hangs must not hold the bench."""

from __future__ import annotations

import pickle
import threading
from collections import deque
from multiprocessing.connection import Connection as Pipe

from benchtool.web.desk.frame import merged
from benchtool.web.desk.news import News

FRAME, NEWS = b"F", b"N"


class Outbox:
    """Hold what is to be sent; a thread of its own hands it over.

    Frames that wait are joined into one, so that the newest is never behind and no extreme lost.
    """

    def __init__(self, pipe: Pipe) -> None:
        self._pipe = pipe
        self._ready = threading.Condition()
        self._news: deque[News] = deque()
        self._frame: bytes | None = None
        self._closing = False
        self._thread = threading.Thread(target=self._send_all, name="outbox", daemon=True)
        self._thread.start()

    def tell(self, news: News) -> None:
        """Send news; all of it arrives, in order."""
        with self._ready:
            self._news.append(news)
            self._ready.notify()

    def show(self, frame: bytes) -> None:
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
                while not (self._news or self._frame or self._closing):
                    self._ready.wait()
                news, self._news = list(self._news), deque()
                frame, self._frame = self._frame, None
                closing = self._closing
            try:
                for item in news:
                    self._pipe.send_bytes(NEWS + pickle.dumps(item))
                if frame is not None:
                    self._pipe.send_bytes(FRAME + frame)
            except OSError:
                return
            if closing:
                return
