"""The bench process: one thread holds the bench, one listens, one tells.

It ends when the page's server closes the pipe, or is killed: motors at zero, the run closed.
"""

from __future__ import annotations

import os
import pickle
import queue
import threading
import time
from contextlib import suppress
from multiprocessing.connection import Connection as Pipe

from benchtool.acquire.inputs import rig_for
from benchtool.bench.address import open_bench
from benchtool.bench.guard import GuardedBench
from benchtool.bench.paced import PacedBench
from benchtool.bench.stoppable import StoppableBench
from benchtool.errors import BenchtoolError, StandstillNotSeen
from benchtool.web.desk.asks import (
    Answer,
    Ask,
    Connect,
    Disconnect,
    Hold,
    Leave,
    Pace,
    Pause,
    Release,
    Stop,
)
from benchtool.web.desk.hand import Hand
from benchtool.web.desk.news import Connection, PressEnded, Said
from benchtool.web.desk.outbox import Outbox
from benchtool.web.desk.session import Session
from benchtool.web.desk.sweeping import Sweeping
from benchtool.web.desk.watch import Watch

VIRTUAL = ("sim:", "replay:")
"""Addresses of benches on a virtual clock."""

PRIORITY = -10
"""Niceness of the bench process, for users that may have it; a choice."""

FASTEST = 100.0
"""Most that a virtual clock may run faster than life; a choice."""


def run_desk(pipe: Pipe) -> None:
    """Serve a page's server over a pipe until it closes; the bench process runs this."""
    # Where the system allows it this loop goes before others: it feeds the device's watchdog.
    with suppress(OSError, AttributeError):
        os.nice(PRIORITY)
    Desk(pipe).run()


class Desk:
    """Own the bench, in the main thread, where signals come.

    Args:
        pipe: to the page's server.
    """

    def __init__(self, pipe: Pipe) -> None:
        self._pipe = pipe
        self._outbox = Outbox(pipe)
        self._asks: queue.SimpleQueue[Ask] = queue.SimpleQueue()
        self._hand = Hand(lambda tab, reason: self._outbox.tell(PressEnded(tab, reason)))
        self._sweeping = Sweeping(self._outbox)
        self._bench: StoppableBench | None = None
        self._pace: PacedBench | None = None
        self._sessions = 0

    def run(self) -> None:
        """Hold one bench after another."""
        threading.Thread(target=self._listen, name="listen", daemon=True).start()
        try:
            while not isinstance(ask := self._asks.get(), Leave):
                if isinstance(ask, Connect):
                    self._hold(ask)
                elif not isinstance(ask, Disconnect):
                    text = "no bench is connected; connect one first"
                    self._outbox.tell(Said(text=text, is_error=True))
        except KeyboardInterrupt:
            pass
        finally:
            self._sweeping.finish()
            self._outbox.close()

    def _listen(self) -> None:
        """Take what the page asks; what cannot wait for the owner of the bench is done here."""
        while True:
            try:
                ask: Ask = pickle.loads(self._pipe.recv_bytes())
            except (EOFError, OSError):
                ask = Leave()
            if isinstance(ask, Stop):
                self._stop(f"stopped from {ask.who}")
            elif isinstance(ask, Hold):
                self._hand.hold(ask, time.monotonic())
            elif isinstance(ask, Release):
                self._hand.release(ask)
            elif isinstance(ask, Pause):
                self._sweeping.pause(ask.on)
            elif isinstance(ask, Answer):
                self._sweeping.answer(ask.text)
            elif isinstance(ask, Pace):
                if (pace := self._pace) is not None:
                    pace.speed = min(max(ask.speed, 0.1), FASTEST)
            elif isinstance(ask, Leave):
                self._stop("the page's server is gone")
                self._asks.put(ask)
                return
            elif self._sweeping.active:
                text = f"a {self._sweeping.what} is under way; stop it first"
                self._outbox.tell(Said(text=text, is_error=True))
            else:
                self._asks.put(ask)

    def _stop(self, reason: str) -> None:
        self._hand.cut(reason)
        if (bench := self._bench) is not None:
            bench.ask_to_stop(reason)

    def _hold(self, ask: Connect) -> None:
        """Open a bench and hold it until it is let go or something ends it."""
        self._sessions += 1
        number = self._sessions
        self._outbox.tell(Connection(status="opening", address=ask.address, session=number))
        reason = unseen = ""
        try:
            rig = rig_for(ask.address, ask.rig or None)
            device = open_bench(ask.address)
            pace = PacedBench(device) if ask.address.startswith(VIRTUAL) else None
            watch = Watch(number, rig, self._outbox, lambda: pace.speed if pace else 0.0)
            stoppable = StoppableBench(pace or device, watch.heard)
            self._bench, self._pace = stoppable, pace
            session = Session(
                ask, number, rig, self._outbox, self._asks, self._hand, self._sweeping, watch
            )
            with stoppable if ask.weighs else GuardedBench(stoppable, rig) as bench:
                session.run(bench)
            state = bench.standstill if isinstance(bench, GuardedBench) else None
            if state is not None and not state.seen:
                self._outbox.tell(Said(text=state.text, is_error=True))
        except BenchtoolError as error:
            reason = str(error)
            unseen = reason if isinstance(error, StandstillNotSeen) else ""
            self._outbox.tell(Said(text=reason, is_error=True))
        finally:
            self._bench = self._pace = None
            self._outbox.tell(
                Connection(address=ask.address, session=number, reason=reason, unseen=unseen)
            )
