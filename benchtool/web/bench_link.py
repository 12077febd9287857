"""The server's end of the bench process: ask, and remember what it tells."""

from __future__ import annotations

import asyncio
import pickle
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace

from benchtool.store.events import Event
from benchtool.web.bench_process import BenchProcess
from benchtool.web.desk.asks import Ask, Leave, Stop
from benchtool.web.desk.news import Connection, Happened, Live, News, PressEnded, Said, Swept
from benchtool.web.desk.outbox import FRAME

KEPT_EVENTS = 200
"""Events of a run that pages show; the run folder has them all."""

PATIENCE_S = 5.0
"""The bench process has so long to stop motors and close a run when the server ends."""


class BenchLink:
    """Ask the bench process, and hold its latest snapshots for every page.

    Everything here runs in the page's loop; `start` is called there.

    Args:
        process: started by `start` unless it is already.
    """

    def __init__(self, process: BenchProcess | None = None) -> None:
        self.connection = Connection()
        self.live = Live()
        self.swept = Swept()
        self.events: list[Event] = []
        self.said: Callable[[Said], None] = lambda said: None
        self.press_ended: Callable[[PressEnded], None] = lambda ended: None
        self.framed: Callable[[bytes], None] = lambda frame: None
        self._process = process or BenchProcess()
        self._closing = False

    def start(self) -> None:
        """Listen to the process."""
        if not self._process.started:
            self._process.start()
        loop = asyncio.get_running_loop()
        threading.Thread(
            target=self._listen, args=(self._process, loop), name="bench news", daemon=True
        ).start()

    def ask(self, ask: Ask) -> None:
        """Send something to the bench process; it answers with news."""
        # A process that is gone is told of, and started again, where it is listened to.
        self._process.send(pickle.dumps(ask))

    def stop(self, who: str) -> None:
        """Stop the motors and whatever runs."""
        self.ask(Stop(who))

    def seen_to_stand(self) -> None:
        """Take somebody's word that the motors stand."""
        self.connection = replace(self.connection, unseen="")

    def close(self) -> None:
        """End the process: it stops the motors and closes its run first."""
        self._closing = True
        self.ask(Leave())
        self._process.end(PATIENCE_S)

    def _listen(self, process: BenchProcess, loop: asyncio.AbstractEventLoop) -> None:
        while True:
            try:
                told = process.receive()
            except (EOFError, OSError):
                break
            # A loop that is closed has no page any more.
            with suppress(RuntimeError):
                loop.call_soon_threadsafe(self._take, told)
        if not self._closing:
            loop.call_soon_threadsafe(self._begin_again)

    def _begin_again(self) -> None:
        """Start another process for one that ended by itself."""
        reason = (
            "the process that held the bench has ended; its motors were not seen to stand: look, "
            "cut the power if they turn, then connect it anew"
        )
        unseen = reason if self.connection.status == "on" else ""
        session = self.connection.session
        self._process = BenchProcess()
        self.start()
        self.connection, self.live = (
            Connection(reason=reason, session=session, unseen=unseen),
            Live(),
        )
        if self.swept.active:
            self.swept = replace(self.swept, status="stopped", reason=reason)
        self.said(Said(text=reason, is_error=True))

    def _take(self, told: bytes) -> None:
        if told[:1] == FRAME:
            self.framed(told[1:])
            return
        news: News = pickle.loads(told[1:])
        if isinstance(news, Connection):
            self.connection = news
            if news.status != "on":
                self.live = Live()
        elif isinstance(news, Live):
            self.live = news
        elif isinstance(news, Swept):
            if news.run != self.swept.run:
                self.events.clear()
            self.swept = news
        elif isinstance(news, Happened):
            self.events.append(news.event)
            del self.events[:-KEPT_EVENTS]
        elif isinstance(news, PressEnded):
            self.press_ended(news)
        else:
            self.said(news)
