"""One connection to a bench, from its opening to its end."""

from __future__ import annotations

import queue
import time

from benchtool.bench.bench import Readings
from benchtool.bench.guard import GuardedBench
from benchtool.bench.stoppable import AskedToStop
from benchtool.core.rig import Rig
from benchtool.web.desk.asks import Ask, Connect, Disconnect, Leave
from benchtool.web.desk.frame import Decimator
from benchtool.web.desk.news import Connection, Said
from benchtool.web.desk.outbox import Outbox

FRAME_S = 0.05
"""Time between two frames: 20 a second."""

LOOK_S = 0.02


class Session:
    """Read a bench and do what is asked of it.

    Args:
        outbox: to the page.
        asks: from the page.
        number: of this session.
    """

    def __init__(self, outbox: Outbox, asks: queue.SimpleQueue[Ask], number: int) -> None:
        self._outbox, self._asks, self._number = outbox, asks, number
        self._frames: Decimator | None = None
        self._begun_s = self._shown_s = time.monotonic()

    def heard(self, readings: Readings) -> None:
        """Show what a read brought; every read of this bench passes here."""
        if self._frames is None:
            self._frames = Decimator(self._number, readings.values.shape[1])
        self._frames.add(readings.values)
        now_s = time.monotonic()
        if now_s - self._shown_s >= FRAME_S:
            # The next frame is due on the grid, unless this one came far too late.
            self._shown_s = max(self._shown_s + FRAME_S, now_s - FRAME_S)
            self._outbox.show(self._frames.take(now_s - self._begun_s))

    def run(self, bench: GuardedBench, address: str, rig: Rig) -> None:
        """Hold an open bench until somebody lets it go."""
        self._outbox.tell(
            Connection(
                status="on",
                address=address,
                session=self._number,
                identity=bench.identity,
                rig=rig,
            )
        )
        while True:
            try:
                ask = self._asks.get_nowait()
            except queue.Empty:
                pass
            else:
                if isinstance(ask, Leave):
                    self._asks.put(ask)
                if isinstance(ask, Leave | Disconnect):
                    return
                self._do(ask)
            try:
                bench.read(LOOK_S)
            except AskedToStop as stopped:
                bench.stop()
                self._outbox.tell(Said(text=str(stopped)))

    def _do(self, ask: Ask) -> None:
        if isinstance(ask, Connect):
            text = "a bench is connected already; disconnect it first"
            self._outbox.tell(Said(text=text, is_error=True))
