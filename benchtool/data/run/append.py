"""Append to a file so that what was appended has left the process when the call returns."""

from __future__ import annotations

import errno
import os
import stat
import sys
from pathlib import Path

from benchtool.core.array import Array
from benchtool.core.channel import Channel
from benchtool.core.errors import FileFormatError, InputError
from benchtool.core.user_file import open_file
from benchtool.data.columns import SAMPLE_START


class AppendFile:
    """Append bytes without a buffer of our own; kill -9 after `write` loses nothing of it.

    A file whose last line was cut in an earlier process is cut back to its last whole line first;
    the fragment is kept in `fragment` for the event log. After a write that failed, that one and
    all later ones stay in memory, for `copy_to`.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.fragment = b""
        self._unwritten: bytearray | None = None
        flags = os.O_RDWR | os.O_CREAT | getattr(os, "O_BINARY", 0)
        flags |= getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
        try:
            self._handle: int | None = os.open(path, flags, 0o666)
        except OSError as error:
            if error.errno != errno.ELOOP:
                raise
            raise _no_file(path, "a symbolic link") from error
        if not stat.S_ISREG(os.fstat(self._handle).st_mode):
            os.close(self._handle)
            raise _no_file(path, "no regular file")
        self._cut_back()

    def lock(self) -> None:
        """Keep other processes from locking the file, until it is closed or the process ends.

        Where the system has no such locks (Windows, some network drives) nothing is kept.

        Raises:
            InputError: another one has locked it.
        """
        if sys.platform == "win32" or self._handle is None:
            return
        import fcntl

        try:
            fcntl.flock(self._handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(
                f"another process measures or closes the run {self.path.parent} now; wait until "
                f"it has ended"
            ) from None
        except OSError:
            pass

    def write(self, data: bytes) -> None:
        """Hand all of `data` to the operating system, or, on a full disk, nothing of it."""
        if self._handle is None:
            raise ValueError(f"{self.path} is closed")
        if self._unwritten is not None:
            self._unwritten += data
            return
        view = memoryview(data)
        try:
            while view:
                view = view[os.write(self._handle, view) :]
        except OSError:
            self._unwritten = bytearray(data)
            # What comes behind a line that was cut could never be read again.
            self._take_back(len(data) - len(view))
            raise

    def sync(self) -> None:
        """Force what was written to the disk."""
        if self._handle is not None and self._unwritten is None:
            os.fsync(self._handle)

    def is_in_place(self) -> bool:
        """Tell whether the file is still found under its name."""
        try:
            there = os.stat(self.path, follow_symlinks=False)
        except OSError:
            return False
        return self._handle is not None and os.path.samestat(there, os.fstat(self._handle))

    def copy_to(self, path: Path, *, whole: bool) -> None:
        """Write what the file holds, and what could not be written to it, into a new file.

        This works for a file that was deleted or moved, too: the handle still leads to it.

        Args:
            path: of the new file.
            whole: with what the file holds, not only what could not be written to it.
        """
        assert self._handle is not None
        with open(path, "xb") as copy:
            os.lseek(self._handle, 0, os.SEEK_SET)
            while whole and (part := os.read(self._handle, 1 << 20)):
                copy.write(part)
            copy.write(self._unwritten or b"")
            copy.flush()
            os.fsync(copy.fileno())

    def close(self) -> None:
        """Force to the disk and close; safe to call twice."""
        if self._handle is not None:
            handle, self._handle = self._handle, None
            try:
                if self._unwritten is None:
                    os.fsync(handle)
            finally:
                os.close(handle)

    def _take_back(self, count: int) -> None:
        assert self._handle is not None
        if count:
            os.ftruncate(self._handle, os.lseek(self._handle, -count, os.SEEK_CUR))

    def _cut_back(self) -> None:
        assert self._handle is not None
        size = os.lseek(self._handle, 0, os.SEEK_END)
        start, tail = size, b""
        while start > 0 and b"\n" not in tail:
            start = max(0, start - 4096)
            os.lseek(self._handle, start, os.SEEK_SET)
            tail = _read_exactly(self._handle, size - start)
        whole = start + tail.rfind(b"\n") + 1
        if whole < size:
            self.fragment = tail[whole - start :]
            os.ftruncate(self._handle, whole)
        os.lseek(self._handle, whole, os.SEEK_SET)


def _no_file(path: Path, what: str) -> FileFormatError:
    return FileFormatError(
        str(path), f"this is {what}, and nothing is written through it; put the file itself there"
    )


def _read_exactly(handle: int, count: int) -> bytes:
    parts = []
    while count > 0 and (part := os.read(handle, count)):
        parts.append(part)
        count -= len(part)
    return b"".join(parts)


class SampleWriter:
    """Append samples; a row has reached the operating system when `append` returns.

    Args:
        path: samples.csv of a run; a new file gets its header, an old one must have the same.
        channels: what the device streams, in its order.
    """

    def __init__(self, path: Path, channels: tuple[Channel, ...]) -> None:
        names = [channel.name for channel in channels]
        header = ",".join([*SAMPLE_START, *names]).encode() + b"\n"
        self.file = AppendFile(path)
        if path.stat().st_size == 0:
            self.file.write(header)
            self.file.sync()
            return
        with open_file(path, follow=False) as file:
            if file.readline() != header:
                self.file.close()
                raise FileFormatError(
                    str(path),
                    "this bench streams other channels than the run has on disk; go on with the "
                    "bench that began it, or start a new run",
                )

    @property
    def fragment(self) -> str:
        """The cut line that a killed process left at the end, empty when there was none."""
        return self.file.fragment.decode("utf-8", "replace")

    def append(
        self, point: int, phase: str, time_s: Array, device_time_us: Array, values: Array
    ) -> None:
        """Append samples.

        Args:
            point: number of the visit they belong to, 0 for none.
            phase: what the bench was doing, one of `columns.PHASES`.
            time_s: (m,) host time since the run began.
            device_time_us: (m,) the device's own time.
            values: (m, c) in channel order; nan becomes an empty cell.
        """
        middle = f",{point},{phase},"
        lines = [
            "%.6f,%.0f%s%s\n" % (time, device, middle, ",".join(map(repr, row)))  # noqa: UP031
            for time, device, row in zip(
                time_s.tolist(), device_time_us.tolist(), values.tolist(), strict=True
            )
        ]
        self.file.write("".join(lines).replace("nan", "").encode("ascii"))

    def sync(self) -> None:
        """Force what was appended to the disk."""
        self.file.sync()

    def close(self) -> None:
        """Force to the disk and close; safe to call twice."""
        self.file.close()
