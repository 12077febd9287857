"""Tell which format a file has, and import it."""

from __future__ import annotations

import hashlib
import os
import re
import shlex
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from benchtool.core.errors import FileFormatError, InputError
from benchtool.core.table_bounds import MOST_LOG_BYTES
from benchtool.core.user_file import open_file, read_file
from benchtool.data.formats.crazyflie import is_crazyflie, read_crazyflie
from benchtool.data.formats.mavlink_walk import is_tlog
from benchtool.data.formats.over_surface import mark_windows
from benchtool.data.formats.rcbenchmark import is_rcbenchmark, read_rcbenchmark
from benchtool.data.formats.uiuc import is_uiuc, read_uiuc
from benchtool.data.repairs.at_rest import as_told, inspect_log, inspect_stand
from benchtool.data.repairs.column_map import read_by_map
from benchtool.data.repairs.imported import Imported, Options
from benchtool.data.repairs.named_columns import read_named
from benchtool.data.repairs.pole_count import compare_speeds
from benchtool.data.repairs.spikes import mend_spikes
from benchtool.data.repairs.time_order import mend_time

_TEXT_LOG = re.compile(rb"(?:[^\n]{0,200}\n){0,8}FMT, ?\d+, ?\d+, ?\w+,")


def import_file(path: str | Path, options: Options | None = None) -> Imported:
    """Return what a foreign file holds, with every repair and doubt.

    Raises:
        FileFormatError: no such file, nothing readable in it, or columns that nobody knows.
    """
    where, options = Path(path), options or Options()
    if os.path.isdir(where):
        words = told_of_folder(where, lambda head, name: _can_import(head, name, options))
        raise FileFormatError(str(path), words)
    return import_bytes(read_file(where, MOST_LOG_BYTES), str(path), options)


def import_files(paths: Sequence[str | Path], options: Options | None = None) -> list[Imported]:
    """Return several files, each held against the others for speeds that differ by a ratio."""
    read = [import_file(path, options) for path in paths]
    compared = compare_speeds(
        [(str(path), item.recording) for path, item in zip(paths, read, strict=True)]
    )
    return [item.with_findings(compared[str(path)]) for path, item in zip(paths, read, strict=True)]


def import_bytes(data: bytes, where: str, options: Options) -> Imported:
    """Return what the bytes of a foreign file hold; see `import_file`."""
    provenance = {
        "file": where,
        "sha256": hashlib.sha256(data).hexdigest(),
        "simulated": "not stated",
    }
    reader = _log_reader(data)
    if reader is not None and options.columns is None:
        read = inspect_log(as_told(reader(data, where, provenance), options))
    else:
        mended = mend_spikes(mend_time(_read_table(data, where, options, provenance)))
        # Doubts come last: what the user repaired is none any more.
        read = inspect_stand(as_told(mended, options))
    return mark_windows(read, options.over, options.near_m)


Reader = Callable[[bytes, str, Mapping[str, str]], Imported]


def _log_reader(data: bytes) -> Reader | None:
    """Return what reads a flight log that begins like this; None for tables.

    The logs' readers are imported only for logs: pyulog and pymavlink take their time.
    """
    if data.startswith(b"\xa3\x95") or _TEXT_LOG.match(data[:4096]):
        from benchtool.data.formats.ardupilot import read_ardupilot

        return read_ardupilot
    if data.startswith(b"ULog\x01\x12\x35"):
        from benchtool.data.formats.px4 import read_px4

        return read_px4
    if is_tlog(data):
        from benchtool.data.formats.mavlink_log import read_mavlink

        return read_mavlink
    return None


def _can_import(head: bytes, where: str, options: Options) -> bool:
    """Tell whether a file that begins like this is a log or a table with columns that are known."""
    if _log_reader(head) is not None:
        return True
    try:
        _read_table(head, where, options, {})
    except InputError:
        return False
    return True


def _read_table(data: bytes, where: str, options: Options, facts: dict[str, str]) -> Imported:
    if options.columns is not None:
        return read_by_map(data, where, options.columns, facts)
    first = data[: 1 << 16].lstrip().split(b"\n", 1)[0].decode("utf-8", "replace")
    if is_rcbenchmark(first):
        return read_rcbenchmark(data, where, facts)
    if is_crazyflie(first):
        return read_crazyflie(data, where, facts)
    if is_uiuc(first):
        return read_uiuc(data, where, facts, options.air_density_kg_m3)
    return read_named(data, where, facts)


HEAD_BYTES = 1 << 16
"""A file's beginning tells its format: a header and some rows."""

LISTED = 8
"""So many files are named; a sentence holds no more. A choice."""


def told_of_folder(folder: Path, can_import: Callable[[bytes, str], bool]) -> str:
    """Return what to do with a folder in words, with the command where files can be imported.

    Args:
        folder: that was named in a file's place.
        can_import: tells it of a file's first bytes and its path.
    """
    found = [
        path
        for path in sorted(folder.iterdir())
        if path.is_file() and can_import(_head_of(path), str(path))
    ]
    if not found:
        inner = [f"{path}/" for path in sorted(folder.iterdir()) if path.is_dir()][:LISTED]
        instead = f"look into {', '.join(inner)}" if inner else "name the file of a log or a table"
        return f"this is a folder, and none of its files is known; {instead}"
    names = [shlex.quote(str(path)) for path in found[:LISTED]]
    rest = f" (and {len(found) - LISTED} more)" if len(found) > LISTED else ""
    return f"this is a folder; name files in it: benchtool import {' '.join(names)}{rest}"


def _head_of(path: Path) -> bytes:
    try:
        with open_file(path) as file:
            head = file.read(HEAD_BYTES)
    except (OSError, FileFormatError):
        return b""
    if len(head) < HEAD_BYTES:
        return head
    return head[: head.rfind(b"\n") + 1] or head
