"""Publish events and frames to the page, never waiting for it: a page that hangs must not hold the
bench.

A frame holds of every channel the least and the greatest since the last frame. It is float32,
little-endian: session, time in s, number of samples, then for each of c channels its least and
greatest value, nan where none came: 3 + 2 c numbers.
"""

from __future__ import annotations

import pickle
import threading
from collections import deque
from multiprocessing.connection import Connection as Pipe

import numpy as np

from benchtool.core.array_type import Array
from benchtool.web.bench_process.messages import BenchEvent

HEAD = 3  # Numbers before the channels


class Decimator:
    """Keep extremes of samples (m, c) between two frames, so that no peak is missed."""

    def __init__(self, session: int, n_channels: int) -> None:
        self._session = session
        self._low: Array = np.full(n_channels, np.nan)
        self._high: Array = np.full(n_channels, np.nan)
        self._count = 0

    def add(self, values: Array) -> None:
        if len(values):
            self._low = np.fmin(self._low, np.fmin.reduce(values, axis=0))
            self._high = np.fmax(self._high, np.fmax.reduce(values, axis=0))
            self._count += len(values)

    def take(self, time_s: float) -> bytes:
        frame = np.empty(HEAD + 2 * len(self._low), "<f4")
        frame[:HEAD] = self._session, time_s, self._count
        frame[HEAD::2], frame[HEAD + 1 :: 2] = self._low, self._high
        self._low, self._high = np.full_like(self._low, np.nan), np.full_like(self._high, np.nan)
        self._count = 0
        return frame.tobytes()


def merged(older: bytes, newer: bytes) -> bytes:
    """Return one frame for two: the newer's time, the extremes of both.

    Frames of another session are not joined; the newer stands alone.
    """
    a, b = np.frombuffer(older, "<f4"), np.frombuffer(newer, "<f4")
    if len(a) != len(b) or a[0] != b[0]:
        return newer
    both = b.copy()
    both[2] = a[2] + b[2]
    both[HEAD::2] = np.fmin(a[HEAD::2], b[HEAD::2])
    both[HEAD + 1 :: 2] = np.fmax(a[HEAD + 1 :: 2], b[HEAD + 1 :: 2])
    return both.tobytes()


def split(frame: bytes) -> tuple[Array, Array]:
    """Return the least and the greatest value of each channel (c,), (c,)."""
    numbers = np.frombuffer(frame, "<f4").astype(float)
    return numbers[HEAD::2], numbers[HEAD + 1 :: 2]


def frame_time_s(frame: bytes) -> float:
    """Return the time of a frame since its session began; 0 where there is none."""
    return float(np.frombuffer(frame, "<f4")[1]) if frame else 0.0


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
