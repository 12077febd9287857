"""The bench process: one thread holds the bench, one listens, one tells.

It ends when the page's server closes the pipe, or is killed: motors at zero, the run closed.
"""

from __future__ import annotations

import pickle
import queue
import threading
from multiprocessing.connection import Connection as Pipe

from benchtool.acquire.sweep_options import rig_for
from benchtool.bench.address import open_bench
from benchtool.bench.guard import GuardedBench
from benchtool.bench.paced import PacedBench
from benchtool.bench.stoppable import StoppableBench
from benchtool.errors import BenchtoolError
from benchtool.web.desk.asks import Ask, Connect, Leave, Stop
from benchtool.web.desk.news import Connection, Said
from benchtool.web.desk.outbox import Outbox
from benchtool.web.desk.session import Session


def run_desk(pipe: Pipe) -> None:
    """Serve a page's server over a pipe until it closes; the bench process runs this."""
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
        self._bench: StoppableBench | None = None
        self._sessions = 0

    def run(self) -> None:
        """Hold one bench after another."""
        threading.Thread(target=self._listen, name="listen", daemon=True).start()
        try:
            while not isinstance(ask := self._asks.get(), Leave):
                if isinstance(ask, Connect):
                    self._hold(ask)
        except KeyboardInterrupt:
            pass
        finally:
            self._outbox.close()

    def _listen(self) -> None:
        """Take what the page asks; a stop is carried out right here."""
        while True:
            try:
                ask: Ask = pickle.loads(self._pipe.recv_bytes())
            except (EOFError, OSError):
                ask = Leave()
            if isinstance(ask, Leave):
                self._stop("the page's server is gone")
                self._asks.put(ask)
                return
            if isinstance(ask, Stop):
                self._stop(f"stopped from {ask.who}")
            else:
                self._asks.put(ask)

    def _stop(self, reason: str) -> None:
        if (bench := self._bench) is not None:
            bench.ask_to_stop(reason)

    def _hold(self, ask: Connect) -> None:
        """Open a bench and hold it until it is let go or something ends it."""
        self._sessions += 1
        told = Connection(status="opening", address=ask.address, session=self._sessions)
        self._outbox.tell(told)
        reason = ""
        try:
            rig = rig_for(ask.address, ask.rig or None)
            device = open_bench(ask.address)
            pace = PacedBench(device) if ask.address.startswith(("sim:", "replay:")) else None
            session = Session(self._outbox, self._asks, self._sessions)
            self._bench = StoppableBench(pace or device, session.heard)
            with GuardedBench(self._bench, rig) as bench:
                session.run(bench, ask.address, rig)
        except BenchtoolError as error:
            reason = str(error)
            self._outbox.tell(Said(text=reason, is_error=True))
        finally:
            self._bench = None
            self._outbox.tell(
                Connection(address=ask.address, session=self._sessions, reason=reason)
            )
