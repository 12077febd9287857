"""Frames of a live stream: of every channel the least and the greatest since the last frame. Pure.

A frame is float32, little-endian: session, time in s, number of samples, then for each of c
channels its least and greatest value, nan where none came: 3 + 2 c numbers.
"""

from __future__ import annotations

import numpy as np

from benchtool.core.array import Array

HEAD = 3
"""Numbers before the channels."""


class Decimator:
    """Keep extremes of samples (m, c) between two frames, so that no peak is missed.

    Args:
        session: number in every frame.
        n_channels: c.
    """

    def __init__(self, session: int, n_channels: int) -> None:
        self._session = session
        self._low: Array = np.full(n_channels, np.nan)
        self._high: Array = np.full(n_channels, np.nan)
        self._count = 0

    def add(self, values: Array) -> None:
        """Take samples (m, c)."""
        if len(values):
            self._low = np.fmin(self._low, np.fmin.reduce(values, axis=0))
            self._high = np.fmax(self._high, np.fmax.reduce(values, axis=0))
            self._count += len(values)

    def take(self, time_s: float) -> bytes:
        """Return a frame of what came since the last one."""
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
