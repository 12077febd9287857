"""One connection to a bench, from its opening to its end."""

from __future__ import annotations

import queue
import time
from datetime import datetime

from benchtool.acquire.arming import CONFIRMATION
from benchtool.acquire.calibration_file import calibration_for
from benchtool.bench.bench import Bench, Identity
from benchtool.bench.guard import GuardedBench
from benchtool.bench.stoppable import AskedToStop
from benchtool.core.rig import Rig
from benchtool.errors import BenchError, BenchtoolError, InputError
from benchtool.web.desk.asks import (
    Arm,
    Ask,
    Calibrate,
    Connect,
    Disconnect,
    Leave,
    MovePlate,
    Record,
    Sweep,
    Tare,
    Weigh,
)
from benchtool.web.desk.hand import Hand
from benchtool.web.desk.news import Connection, Said
from benchtool.web.desk.outbox import Outbox
from benchtool.web.desk.recording import record
from benchtool.web.desk.sweeping import Sweeping
from benchtool.web.desk.throttle import Throttle
from benchtool.web.desk.watch import Watch
from benchtool.web.desk.weighing import Weighing

LOOK_S = 0.02
"""Longest read between two looks at what is asked."""


class Session:
    """Read a bench and do what is asked of it, in the thread that owns it.

    Args:
        connect: what was asked.
        number: of this session.
        rig: what stands on the bench.
        outbox: to the page.
        asks: from the page.
        hand: on the throttle.
        sweeping: what a sweep and the page say to each other.
        watch: what is told of every sample.
    """

    def __init__(
        self,
        connect: Connect,
        number: int,
        rig: Rig,
        outbox: Outbox,
        asks: queue.SimpleQueue[Ask],
        hand: Hand,
        sweeping: Sweeping,
        watch: Watch,
    ) -> None:
        self._connect, self._number, self._rig = connect, number, rig
        self._outbox, self._asks, self._hand = outbox, asks, hand
        self._sweeping, self._watch = sweeping, watch
        self._throttle = Throttle(rig)
        self._weighing = Weighing()
        self._armed = False

    def run(self, bench: Bench) -> None:
        """Hold an open bench until somebody lets it go.

        Raises:
            BenchtoolError: what ended it.
        """
        guarded = bench if isinstance(bench, GuardedBench) else None
        self._armed = guarded is not None and bench.identity.simulated
        self._watch.begin(bench.identity, guarded)
        self._tell_on(bench.identity)
        while True:
            try:
                ask = self._next()
                if isinstance(ask, Leave):
                    self._asks.put(ask)
                if isinstance(ask, Leave | Disconnect):
                    return
                if ask is not None:
                    self._do(bench, guarded, ask)
                if guarded is not None:
                    self._turn(guarded)
                bench.read(LOOK_S)
                if guarded is not None:
                    guarded.check_standstill()
            except AskedToStop as stopped:
                self._hand.cut(str(stopped))
                bench.stop()
                self._outbox.tell(Said(text=str(stopped)))
            self._watch.note(
                armed=self._armed,
                weighed=self._weighing.weighed,
            )

    def _next(self) -> Ask | None:
        try:
            return self._asks.get_nowait()
        except queue.Empty:
            return None

    def _do(self, bench: Bench, guarded: GuardedBench | None, ask: Ask) -> None:
        """Carry out what was asked; what was wrong with it is told, what ends a bench is raised."""
        try:
            if isinstance(ask, Weigh | Calibrate):
                self._calibrate(bench, guarded, ask)
            elif isinstance(ask, Connect):
                raise InputError("a bench is connected already; disconnect it first")
            elif guarded is None:
                raise InputError("this bench is held for masses only; connect it anew")
            else:
                self._act(guarded, ask)
        except AskedToStop:
            raise
        except BenchtoolError as error:
            if isinstance(error, BenchError) and guarded is not None and guarded.reason:
                raise
            self._outbox.tell(Said(text=str(error), is_error=True))

    def _act(self, bench: GuardedBench, ask: Ask) -> None:
        if isinstance(ask, Arm):
            self._armed = bench.identity.simulated or ask.typed.strip() == CONFIRMATION
            if not self._armed:
                raise InputError(f"not armed: {CONFIRMATION} was not typed; nothing was spun")
        elif isinstance(ask, Tare):
            bench.tare()
            self._outbox.tell(Said(text="tared"))
        elif isinstance(ask, MovePlate):
            self._watch.note(busy=f"moving the plate to {1e3 * ask.z_m:.0f} mm")
            bench.move_plate(ask.z_m)
            self._watch.note(busy="")
        elif isinstance(ask, Sweep):
            self._hand.cut("a sweep begins")
            bench.stop()
            self._sweeping.run(bench, self._rig, ask)
        elif isinstance(ask, Record):
            self._hand.cut("a recording begins")
            bench.stop()
            record(bench, self._rig, ask, self._sweeping)

    def _turn(self, bench: GuardedBench) -> None:
        """Let motors follow the hand."""
        now_s = time.monotonic()
        wanted = self._hand.wanted(now_s)
        if wanted is not None and not self._armed:
            text = f"motors are not armed; type {CONFIRMATION} first"
            self._hand.cut(text)
            self._outbox.tell(Said(text=text, is_error=True))
            wanted = None
        try:
            self._throttle.follow(bench, wanted, now_s)
        except InputError as error:
            self._hand.cut(str(error))
            self._outbox.tell(Said(text=str(error), is_error=True))

    def _calibrate(
        self, bench: Bench, guarded: GuardedBench | None, ask: Weigh | Calibrate
    ) -> None:
        if guarded is not None:
            raise InputError("masses need a bench without limits; press Calibrate first")
        if isinstance(ask, Weigh):
            self._watch.note(busy=f"averaging counts under {ask.mass_kg:g} kg")
            self._weighing.weigh(bench, self._rig, ask.mass_kg, ask.seconds)
            self._watch.note(busy="")
        elif ask.keep:
            device_id = bench.identity.device_id
            kept = self._weighing.fit(device_id, lambda: datetime.now().astimezone())
            self._tell_on(bench.identity)
            text = (
                f"calibrated: {1e6 * kept.slope_N_per_count:.6g} uN per count, kept for {device_id}"
            )
            self._outbox.tell(Said(text=text))
        else:
            self._weighing.forget()

    def _tell_on(self, identity: Identity) -> None:
        self._outbox.tell(
            Connection(
                status="on",
                address=self._connect.address,
                session=self._number,
                identity=identity,
                rig=self._rig,
                calibration=calibration_for(None, identity),
                weighs=self._connect.weighs,
            )
        )
