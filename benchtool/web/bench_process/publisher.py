"""Publisher of events and frames. It never blocks, so an unresponsive page cannot delay the bench.

A frame contains each channel's minimum and maximum since the last frame, as 4 + 2 c little-endian
float32 values: session, time in s, number of samples, number of lost samples, then minimum and
maximum of each of the c channels, nan without samples.
"""

from __future__ import annotations

import pickle
import threading
from collections import deque
from multiprocessing.connection import Connection as Pipe

import numpy as np

from benchtool.core.units import Array
from benchtool.web.bench_process.messages import BenchEvent, Notice

HEADER_LENGTH = 4  # values before the channels


class Decimator:
    """Running minimum and maximum of samples (m, c) between two frames."""

    def __init__(self, session: int, n_channels: int) -> None:
        self._session = session
        self._low: Array = np.full(n_channels, np.nan)
        self._high: Array = np.full(n_channels, np.nan)
        self._count = self._lost = 0

    def add(self, values: Array, lost: int = 0) -> None:
        self._lost += lost
        if len(values):
            self._low = np.fmin(self._low, np.fmin.reduce(values, axis=0))
            self._high = np.fmax(self._high, np.fmax.reduce(values, axis=0))
            self._count += len(values)

    def pop_frame(self, time_s: float) -> bytes:
        frame = np.empty(HEADER_LENGTH + 2 * len(self._low), "<f4")
        frame[:HEADER_LENGTH] = self._session, time_s, self._count, self._lost
        frame[HEADER_LENGTH::2], frame[HEADER_LENGTH + 1 :: 2] = self._low, self._high
        self._low, self._high = np.full_like(self._low, np.nan), np.full_like(self._high, np.nan)
        self._count = self._lost = 0
        return frame.tobytes()


def merge_frames(older: bytes, newer: bytes) -> bytes:
    """Return one frame with the newer time and both extremes; the newer one after a new session."""
    a, b = np.frombuffer(older, "<f4"), np.frombuffer(newer, "<f4")
    if len(a) != len(b) or a[0] != b[0]:
        return newer
    merged = b.copy()
    merged[2:HEADER_LENGTH] += a[2:HEADER_LENGTH]
    merged[HEADER_LENGTH::2] = np.fmin(a[HEADER_LENGTH::2], b[HEADER_LENGTH::2])
    merged[HEADER_LENGTH + 1 :: 2] = np.fmax(a[HEADER_LENGTH + 1 :: 2], b[HEADER_LENGTH + 1 :: 2])
    return merged.tobytes()


def frame_time_s(frame: bytes) -> float:
    """Return the time of a frame since its session began; 0 for an empty frame."""
    return float(np.frombuffer(frame, "<f4")[1]) if frame else 0.0


FRAME, EVENT = b"F", b"E"


class EventPublisher:
    """Queue of events and frames, sent by a separate thread.

    Queued frames are merged into one: no extreme is lost and the newest is never delayed.
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
        """Send an event; events are sent in order, none is dropped."""
        with self._ready:
            self._events.append(event)
            self._ready.notify()

    def report_error(self, text: str) -> None:
        """Show an error once on every page."""
        self.publish(Notice(text=text, is_error=True))

    def publish_frame(self, frame: bytes) -> None:
        with self._ready:
            self._frame = frame if self._frame is None else merge_frames(self._frame, frame)
            self._ready.notify()

    def close(self, timeout_s: float = 1.0) -> None:
        """Send queued messages and end; give up after a timeout if the pipe is blocked."""
        with self._ready:
            self._closing = True
            self._ready.notify()
        self._thread.join(timeout_s)

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
