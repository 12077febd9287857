"""What is told of every sample: frames for the charts, and a few numbers four times a second."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from benchtool.bench.bench import Identity, Readings
from benchtool.bench.guard import GuardedBench
from benchtool.core.rig import Rig
from benchtool.web.desk.frame import Decimator, merged, split
from benchtool.web.desk.near import near_limits
from benchtool.web.desk.news import Live, Said
from benchtool.web.desk.outbox import Outbox

FRAME_S = 0.05
"""Time between two frames: 20 a second."""

LIVE_FRAMES = 5
"""Frames from one look at the limits to the next: four a second."""


class Watch:
    """Hear every read of a bench and tell the page.

    Args:
        session: number of this connection.
        rig: its limits.
        outbox: to the page.
        speed: of a virtual clock, 0 where it is the wall's.
        clock: monotonic wall clock in seconds.
    """

    def __init__(
        self,
        session: int,
        rig: Rig,
        outbox: Outbox,
        speed: Callable[[], float],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._session, self._rig, self._outbox = session, rig, outbox
        self._speed, self._clock = speed, clock
        self._guarded: GuardedBench | None = None
        self._names: tuple[str, ...] = ()
        self._frames: Decimator | None = None
        self._looked: bytes | None = None
        self._live = Live()
        self._begun_s = self._shown_s = clock()
        self._since_look = 0
        self._counted, self._counted_s = 0, 0.0

    def begin(self, identity: Identity, guarded: GuardedBench | None) -> None:
        """Tell from now on; what is read before the bench is known is left out."""
        self._guarded = guarded
        self._names = tuple(channel.name for channel in identity.channels)
        self._frames = Decimator(self._session, len(self._names))
        self._begun_s = self._shown_s = self._clock()

    def note(self, **facts: Any) -> None:
        """Keep what is to be told with the next look; a change of what is busy is told at once."""
        hurry = "busy" in facts and facts["busy"] != self._live.busy
        self._live = replace(self._live, **facts)
        if hurry:
            self._outbox.tell(self._live)

    def heard(self, readings: Readings) -> None:
        """Take what a read brought; every read of the bench passes here."""
        if self._frames is None:
            return
        self._frames.add(readings.values)
        live = self._live
        self._live = replace(
            live,
            samples=live.samples + len(readings),
            lost=live.lost + readings.lost,
            corrupt=live.corrupt + readings.corrupt,
        )
        for message in readings.messages:
            if not message.startswith("arrived"):
                self._outbox.tell(Said(text=f"device: {message}"))
        self._show(self._frames, float(readings.time_s[-1]) if len(readings) else None)

    def _show(self, frames: Decimator, newest_s: float | None) -> None:
        now_s = self._clock()
        if now_s - self._shown_s < FRAME_S:
            return
        # The next frame is due on the grid, unless this one came far too late.
        self._shown_s = max(self._shown_s + FRAME_S, now_s - FRAME_S)
        frame = frames.take(now_s - self._begun_s)
        self._looked = frame if self._looked is None else merged(self._looked, frame)
        self._outbox.show(frame)
        self._since_look += 1
        if self._since_look >= LIVE_FRAMES:
            self._look(newest_s)

    def _look(self, newest_s: float | None) -> None:
        assert self._looked is not None
        low, high = split(self._looked)
        self._looked, self._since_look = None, 0
        pulses = tuple(self._guarded.pwm_us.tolist()) if self._guarded else ()
        seen = self._guarded.standstill if self._guarded else None
        rate_Hz = self._live.rate_Hz
        if newest_s is not None:
            if self._counted_s and newest_s > self._counted_s:
                rate_Hz = (self._live.samples - self._counted) / (newest_s - self._counted_s)
            self._counted, self._counted_s = self._live.samples, newest_s
        self._live = replace(
            self._live,
            pulses_us=pulses,
            rate_Hz=rate_Hz,
            near=near_limits(self._names, low, high, pulses, self._rig.limits),
            speed=self._speed(),
            standstill=seen.text if seen else "",
        )
        self._outbox.tell(self._live)
