"""Append-only files of a run, written without a buffer, and marking of interrupted samples."""

from __future__ import annotations

import errno
import json
import os
import stat
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import BinaryIO

from benchtool.core.channel import Channel
from benchtool.core.errors import FileFormatError, InputError
from benchtool.core.toml_text import build_dataclass, parse_json
from benchtool.core.units import Array
from benchtool.core.user_file import MAX_METADATA_BYTES, open_file, read_text
from benchtool.data.atomic import sync_folder
from benchtool.data.columns import MAX_DEVICE_TIME_US, MAX_RUN_DURATION_S, SAMPLE_START


class AppendFile:
    """Unbuffered append-only file; data survive kill -9 once `write` has returned.

    An incomplete last line of an earlier process is removed on opening; `fragment` is its text,
    for the event log. After a failed write, its data and all later data stay in memory for
    `copy_to`. Raises InputError if another process has an exclusive file open.
    """

    EXCLUSIVE = False  # True: only one process at a time can open the file

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
            raise _file_type_error(path, "a symbolic link") from error
        self._status = os.fstat(self._handle)
        if not stat.S_ISREG(self._status.st_mode):
            os.close(self._handle)
            raise _file_type_error(path, "not a regular file")
        try:
            if self.EXCLUSIVE:
                self._lock()
            # After the lock: another process may be writing the last line.
            self._truncate_fragment(self._handle)
        except BaseException:
            self.close()
            raise

    def _lock(self) -> None:
        """Lock the file against other processes until it is closed or the process ends.

        No-op on systems without such locks (Windows, some network drives).
        """
        if sys.platform == "win32" or self._handle is None:
            return
        import fcntl

        try:
            fcntl.flock(self._handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(
                f"the run {self.path.parent} is in use by another process; wait until that "
                f"process ends"
            ) from None
        except OSError:
            pass

    def write(self, data: bytes) -> None:
        """Write all of `data` to the operating system or, if that fails, none of it."""
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
                # Rows appended to an incomplete line would be unreadable.
                os.ftruncate(self._handle, os.lseek(self._handle, -written, os.SEEK_CUR))
            raise

    def sync(self) -> None:
        """Flush written data to the disk."""
        if self._handle is not None and self._unwritten is None:
            os.fsync(self._handle)

    def is_in_place(self) -> bool:
        """Return whether the path still refers to the open file."""
        try:
            status = os.stat(self.path, follow_symlinks=False)
        except OSError:
            return False
        return self._handle is not None and os.path.samestat(status, self._status)

    def copy_to(self, path: Path, *, whole: bool) -> None:
        """Write the contents of the file (if `whole`) and the unwritten data to a new file.

        Works for a deleted or moved file too, through the open handle.
        """
        assert self._handle is not None
        with open(path, "xb") as copy:
            os.lseek(self._handle, 0, os.SEEK_SET)
            while whole and (block := os.read(self._handle, 1 << 20)):
                copy.write(block)
            copy.write(self._unwritten or b"")
            copy.flush()
            os.fsync(copy.fileno())

    def close(self) -> None:
        """Flush to the disk and close; safe to call twice."""
        if self._handle is not None:
            handle, self._handle = self._handle, None
            try:
                if self._unwritten is None:
                    os.fsync(handle)
            finally:
                os.close(handle)

    def _truncate_fragment(self, handle: int) -> None:
        size = os.lseek(handle, 0, os.SEEK_END)
        start, tail = size, b""
        while start > 0 and b"\n" not in tail:
            start = max(0, start - 4096)
            os.lseek(handle, start, os.SEEK_SET)
            tail = b"".join(iter(lambda: os.read(handle, 1 << 20), b""))
        end = start + tail.rfind(b"\n") + 1
        if end < size:
            self.fragment = tail[end - start :].decode("utf-8", "replace")
            os.ftruncate(handle, end)
        os.lseek(handle, end, os.SEEK_SET)


def _file_type_error(path: Path, file_type: str) -> FileFormatError:
    return FileFormatError(
        str(path), f"this is {file_type}; a run needs a regular file here, replace it with one"
    )


class AppendTable(AppendFile):
    """Append-only table; an existing file with other columns raises the message `mismatch`."""

    def __init__(self, path: Path, columns: Sequence[str], mismatch: str) -> None:
        super().__init__(path)
        header = ",".join(columns).encode() + b"\n"
        if path.stat().st_size == 0:
            self.write(header)
            self.sync()
            return
        with open_file(path, follow=False) as file:
            if file.readline() != header:
                self.close()
                raise FileFormatError(str(path), mismatch)


class SampleWriter(AppendTable):
    """Writer of samples.csv; rows are passed to the operating system when `append` returns."""

    def __init__(self, path: Path, channels: tuple[Channel, ...]) -> None:
        names = (*SAMPLE_START, *(channel.name for channel in channels))
        mismatch = (
            "its columns differ from the channels of this bench; resume with the bench that "
            "started the run, or start a new run"
        )
        super().__init__(path, names, mismatch)

    def append(
        self, point: int, phase: str, time_s: Array, device_time_us: Array, values: Array
    ) -> None:
        """Append samples: times (m,) since the start of the run, values (m, c) in channel order.

        Their point is 0 for none; nan becomes an empty cell.
        """
        point_cells = f",{point},{phase},"
        lines = [
            "%.6f,%.0f%s%s\n" % (time, device_us, point_cells, ",".join(map(repr, row)))  # noqa: UP031
            for time, device_us, row in zip(
                time_s.tolist(), device_time_us.tolist(), values.tolist(), strict=True
            )
        ]
        self.write("".join(lines).replace("nan", "").encode("ascii"))


_INTERRUPTED = b"interrupted"


@dataclass(frozen=True, slots=True)
class SampleScan:
    """Number of rows and end time of samples.csv."""

    rows: int
    last_s: float  # latest time since the start of the run; 0 without rows


def write_marked_samples(path: Path, measured: frozenset[int]) -> SampleScan:
    """Scan samples.csv; write a copy with phase `interrupted` in rows of unmeasured points, if any.

    An incomplete last line is ignored. No other cell changes; `install_marked_samples` replaces the
    original with the copy.
    """
    rows, last_s, unmarked_offset = 0, 0.0, None
    finished = {b"0", *(str(point).encode() for point in measured)}
    with open_file(path, follow=False) as file:
        offset = len(file.readline())
        for number, line in enumerate(file, 2):
            if not line.endswith(b"\n"):
                break
            cells = line.split(b",", 4)
            try:
                time_s, point, phase = float(cells[0]), cells[2], cells[3]
                device_us = float(cells[1])
                in_range = (
                    abs(time_s) <= MAX_RUN_DURATION_S and abs(device_us) <= MAX_DEVICE_TIME_US
                )
                if not (in_range and point.isdigit()):
                    raise ValueError
            except (ValueError, IndexError):
                raise FileFormatError(
                    f"{path}, line {number}",
                    f"it starts with {line[:40].decode('utf-8', 'replace').strip()!r}; expected: "
                    f"finite time_s, device time, point and phase; correct or delete that line",
                ) from None
            rows += 1
            last_s = max(last_s, time_s)
            if unmarked_offset is None and point not in finished and phase != _INTERRUPTED:
                unmarked_offset = offset
            offset += len(line)
        if unmarked_offset is not None:
            _copy_marked(file, _marked_path(path), unmarked_offset, finished)
    return SampleScan(rows, last_s)


def _copy_marked(old: BinaryIO, path: Path, offset: int, finished: set[bytes]) -> None:
    """Write a copy of samples.csv with the rows from this offset on marked."""
    old.seek(0)
    with open(path, "xb") as new:
        while offset and (block := old.read(min(offset, 1 << 20))):
            new.write(block)
            offset -= len(block)
        for line in old:
            cells = line.split(b",", 4)
            interrupted = len(cells) == 5 and cells[2] not in finished and line.endswith(b"\n")
            new.write(b",".join([*cells[:3], _INTERRUPTED, cells[4]]) if interrupted else line)
        new.flush()
        os.fsync(new.fileno())


def install_marked_samples(path: Path) -> None:
    """Replace samples.csv atomically with the copy of `write_marked_samples`, if there is one."""
    with suppress(FileNotFoundError):
        os.replace(_marked_path(path), path)
        sync_folder(path.parent)


def _marked_path(path: Path) -> Path:
    return path.with_name(f".{path.name}.marked.new")


ANNOTATION = "annotation"  # event name of an operator's note


@dataclass(frozen=True, slots=True)
class Event:
    """Entry of events.jsonl."""

    time_s: float  # bench time since the start of the run
    event: str  # name of the event ("settle_timeout", "tare", "stopped", "device")
    text: str  # message for the operator, one sentence
    point: int = 0  # number of the point, 0 for none
    wall: str = ""  # date and time with UTC offset


class EventLog(AppendFile):
    """Writer of events.jsonl, one JSON object per line; flushed when `append` returns.

    Its lock marks the process that measures or closes the run.
    """

    EXCLUSIVE = True

    def append(self, event: Event) -> None:
        """Append one event with the wall time."""
        data = asdict(event)
        data["wall"] = event.wall or datetime.now(UTC).isoformat(timespec="milliseconds")
        self.write(json.dumps(data, ensure_ascii=False).encode() + b"\n")
        self.sync()


def read_events(path: Path) -> tuple[Event, ...]:
    """Return the events of a run, oldest first; invalid lines are ignored."""
    if not os.path.lexists(path):
        return ()
    events = []
    for line in read_text(path, MAX_METADATA_BYTES, follow=False).splitlines():
        try:
            events.append(build_dataclass(Event, parse_json(line, str(path)), str(path)))
        except InputError:
            continue
    return tuple(events)
