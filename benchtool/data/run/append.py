"""Files of a run that grow: each append has left the process when the call returns."""

from __future__ import annotations

import errno
import json
import os
import stat
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path

from benchtool.core.array_type import Array
from benchtool.core.channel import Channel
from benchtool.core.errors import FileFormatError, InputError
from benchtool.core.parsed_text import parse_json
from benchtool.core.toml_text import build_dataclass
from benchtool.core.user_file import MAX_METADATA_BYTES, open_file, read_text
from benchtool.data.columns import SAMPLE_START


class AppendFile:
    """Append bytes without a buffer of our own; kill -9 after `write` loses nothing of it.

    A file whose last line was cut in an earlier process is cut back to its last whole line first;
    `fragment` holds what stood behind it, for the event log. After a write that failed, that one
    and all later ones stay in memory, for `copy_to`.

    Raises:
        InputError: another process has an exclusive file open.
    """

    EXCLUSIVE = False  # Whether one process at a time may have the file open

    def __init__(self, path: Path) -> None:
        self.path = path
        self.fragment = ""
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
        try:
            if self.EXCLUSIVE:
                self._lock()
            # What another process is writing now is no line that was cut.
            self._cut_back(self._handle)
        except BaseException:
            self.close()
            raise

    def _lock(self) -> None:
        """Keep other processes from opening the file, until it is closed or the process ends.

        Where the system has no such locks (Windows, some network drives) nothing is locked.
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
            if written := len(data) - len(view):
                # What comes behind a line that was cut could never be read again.
                os.ftruncate(self._handle, os.lseek(self._handle, -written, os.SEEK_CUR))
            raise

    def sync(self) -> None:
        """Force what was written to the disk."""
        if self._handle is not None and self._unwritten is None:
            os.fsync(self._handle)

    def is_in_place(self) -> bool:
        """Return whether the file is still found under its name."""
        try:
            there = os.stat(self.path, follow_symlinks=False)
        except OSError:
            return False
        return self._handle is not None and os.path.samestat(there, os.fstat(self._handle))

    def copy_to(self, path: Path, *, whole: bool) -> None:
        """Write what the file holds, and what could not be written to it, into a new file.

        This works for a file that was deleted or moved, too: the handle still leads to it.

        Args:
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

    def _cut_back(self, handle: int) -> None:
        size = os.lseek(handle, 0, os.SEEK_END)
        start, tail = size, b""
        while start > 0 and b"\n" not in tail:
            start = max(0, start - 4096)
            os.lseek(handle, start, os.SEEK_SET)
            tail = b"".join(iter(lambda: os.read(handle, 1 << 20), b""))
        whole = start + tail.rfind(b"\n") + 1
        if whole < size:
            self.fragment = tail[whole - start :].decode("utf-8", "replace")
            os.ftruncate(handle, whole)
        os.lseek(handle, whole, os.SEEK_SET)


def _no_file(path: Path, what: str) -> FileFormatError:
    return FileFormatError(
        str(path), f"this is {what}, and nothing is written through it; put the file itself there"
    )


class AppendTable(AppendFile):
    """Append rows below a header; a new file gets it, an old one must have the same.

    Args:
        advice: what an old file with other columns means, for people.
    """

    def __init__(self, path: Path, columns: Sequence[str], advice: str) -> None:
        super().__init__(path)
        header = ",".join(columns).encode() + b"\n"
        if path.stat().st_size == 0:
            self.write(header)
            self.sync()
            return
        with open_file(path, follow=False) as file:
            if file.readline() != header:
                self.close()
                raise FileFormatError(str(path), advice)


class SampleWriter(AppendTable):
    """Append samples; a row has reached the operating system when `append` returns."""

    def __init__(self, path: Path, channels: tuple[Channel, ...]) -> None:
        names = (*SAMPLE_START, *(channel.name for channel in channels))
        advice = (
            "this bench streams other channels than the run has on disk; go on with the bench "
            "that began it, or start a new run"
        )
        super().__init__(path, names, advice)

    def append(
        self, point: int, phase: str, time_s: Array, device_time_us: Array, values: Array
    ) -> None:
        """Append samples.

        Args:
            point: number of the visit they belong to, 0 for none.
            phase: what the bench was doing, one of `columns.PHASES`.
            time_s: (m,) host time since the run began.
            values: (m, c) in channel order; nan becomes an empty cell.
        """
        middle = f",{point},{phase},"
        lines = [
            "%.6f,%.0f%s%s\n" % (time, device, middle, ",".join(map(repr, row)))  # noqa: UP031
            for time, device, row in zip(
                time_s.tolist(), device_time_us.tolist(), values.tolist(), strict=True
            )
        ]
        self.write("".join(lines).replace("nan", "").encode("ascii"))


ANNOTATION = "annotation"  # Name of the event that holds what the operator wrote


@dataclass(frozen=True, slots=True)
class Event:
    """Say that something happened.

    Attributes:
        time_s: since the run began, on the bench's clock.
        event: what, in one word ("settle_timeout", "tare", "stopped", "device").
        text: one sentence for people.
        point: number of the visit, 0 for none.
        wall: date and time with the offset from UTC.
    """

    time_s: float
    event: str
    text: str
    point: int = 0
    wall: str = ""


class EventLog(AppendFile):
    """Append events, a JSON object a line; each is on the disk when `append` returns.

    Whoever has it open is the one that measures or closes the run.
    """

    EXCLUSIVE = True

    def append(self, event: Event) -> None:
        """Append one event, stamped with the wall clock."""
        data = asdict(event)
        data["wall"] = event.wall or datetime.now(UTC).isoformat(timespec="milliseconds")
        self.write(json.dumps(data, ensure_ascii=False).encode() + b"\n")
        self.sync()


def read_events(path: Path) -> tuple[Event, ...]:
    """Return the events of a run, oldest first; a line that is no event is left out."""
    if not os.path.lexists(path):
        return ()
    events = []
    for line in read_text(path, MAX_METADATA_BYTES, follow=False).splitlines():
        try:
            events.append(build_dataclass(Event, parse_json(line, str(path)), str(path)))
        except InputError:
            continue
    return tuple(events)
