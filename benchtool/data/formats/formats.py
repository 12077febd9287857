"""Import of foreign files, with format detection by content.

A new format is a module with a reader, and a line in `FORMATS`.
"""

from __future__ import annotations

import hashlib
import os
import re
import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from math import isfinite
from pathlib import Path
from typing import Literal

import numpy as np

from benchtool.core.errors import FileFormatError, InputError
from benchtool.core.units import Array
from benchtool.core.user_file import MAX_LOG_BYTES, open_file, read_file
from benchtool.data.csv_header import has_columns
from benchtool.data.csv_text import parse_rows
from benchtool.data.formats.ardupilot import HEAD, read_binary, read_text
from benchtool.data.formats.crazyflie import read_crazyflie
from benchtool.data.formats.mavlink_log import is_tlog, read_mavlink
from benchtool.data.formats.px4 import read_px4
from benchtool.data.formats.rcbenchmark import read_rcbenchmark
from benchtool.data.formats.uiuc import is_uiuc, read_uiuc
from benchtool.data.quantities import dependent_quantities
from benchtool.data.repairs.column_mapping import read_by_map, read_by_names
from benchtool.data.repairs.flight_windows import extract_hover_points, mark_windows
from benchtool.data.repairs.import_result import Finding, ImportOptions, ImportResult
from benchtool.data.repairs.stand_checks import (
    compare_speeds,
    estimate_zero,
    inspect_log,
    inspect_stand,
    remove_spikes,
    repair_time_order,
)

HEAD_BYTES = 1 << 16  # read for format detection: a header and some rows; assumed
MAX_LISTED = 8  # file names in a message; assumed

_TEXT_LOG = re.compile(rb"(?:[^\n]{0,200}\n){0,8}FMT, ?\d+, ?\d+, ?\w+,")


Kind = Literal["log", "table"]


@dataclass(frozen=True, slots=True)
class Format:
    """Entry of the format registry."""

    name: str
    kind: Kind  # a table's time order and known faults are checked
    recognizes: Callable[[bytes], bool]  # tests the first bytes of a file
    read: Callable[..., ImportResult]  # of (bytes, path) of a log, or (TextTable, options)
    detected_by: str  # for the reader of docs/reference/import.md, as is the description
    description: str


FORMATS: tuple[Format, ...] = (  # others are read by `BY_MAP` or `BY_NAMES`
    Format(
        "ArduPilot DataFlash", "log", lambda head: head.startswith(HEAD), read_binary, "`A3 95`",
        "NumPy over the self-describing records; numbers equal to those of pymavlink's DFReader",
    ),
    Format(
        "ArduPilot DataFlash text", "log", lambda head: _TEXT_LOG.match(head[:4096]) is not None,
        read_text, "a line `FMT, ...`", "line by line",
    ),
    Format(
        "PX4 ULog", "log", lambda head: head.startswith(b"ULog\x01\x12\x35"), read_px4, "`ULog`",
        "pyulog, complete messages only",
    ),
    Format(
        "MAVLink tlog", "log", is_tlog, read_mavlink, "time stamp, then `FE` or `FD`",
        "frames with checksum, message layouts from pymavlink",
    ),
    Format(
        "RCbenchmark", "table", has_columns("Time", "Thrust", any_of=("ESC", "ESC signal")),
        read_rcbenchmark, "columns Time, Thrust, ESC",
        "Tyto 1520, 1580/1585, 1780; by column name; unit of thrust from the header",
    ),
    Format(
        "Crazyflie system_id", "table", has_columns("weight", "pwm", "rpm1", "rpm4"),
        read_crazyflie, "columns weight, pwm, rpm1..4",
        "weight is the total thrust; pwm is the raw value",
    ),
    Format(
        "UIUC static", "table", is_uiuc, read_uiuc, "`RPM CT CP`",
        "propeller database; T = C_T rho n^2 D^4; diameter from the file's name, rho by "
        "`--air-density`",
    ),
)  # fmt: skip
BY_MAP = Format(
    "column map", "table", lambda head: True, read_by_map,
    "`--columns MAP.toml`", "CSV and Parquet, by the map",
)  # fmt: skip
BY_NAMES = Format(
    "named columns", "table", lambda head: True, read_by_names,
    "no other format fits", "CSV and Parquet, known names and units in brackets",
)  # fmt: skip


def detect_format(head: bytes) -> Format | None:
    """Return the format of a file with these first bytes, or None if it is unknown."""
    return next((entry for entry in FORMATS if entry.recognizes(head[:HEAD_BYTES])), None)


def is_stand_table(path: str | Path) -> bool:
    """Return whether a file is a table of a test stand in a known format."""
    with open_file(Path(path)) as file:
        file_format = detect_format(file.read(HEAD_BYTES))
    return file_format is not None and file_format.kind == "table"


def import_file(path: str | Path, options: ImportOptions | None = None) -> ImportResult:
    """Return the recording of a foreign file, with all findings."""
    where, options = Path(path), options or ImportOptions()
    if os.path.isdir(where):
        raise FileFormatError(str(path), _explain_folder(where, options))
    return import_bytes(read_file(where, MAX_LOG_BYTES), str(path), options)


@np.errstate(over="ignore")
def import_files(
    paths: Sequence[str | Path], options: ImportOptions | None = None
) -> list[ImportResult]:
    """Return the imports of several files, with findings for speeds that differ by a ratio."""
    results = [import_file(path, options) for path in paths]
    compared = compare_speeds(
        [(str(path), result.recording) for path, result in zip(paths, results, strict=True)]
    )
    pairs = zip(paths, results, strict=True)
    return [result.with_findings(compared[str(path)]) for path, result in pairs]


@np.errstate(over="ignore", invalid="ignore")  # a cell may be 1e308, a log value a signalling nan
def import_bytes(data: bytes, where: str, options: ImportOptions) -> ImportResult:
    """Return the import of a foreign file's bytes; see `import_file`."""
    file_format = _select_format(data, options)
    is_log, read = file_format.kind == "log", file_format.read
    result = read(data, where) if is_log else read(parse_rows(data, where), options)
    provenance = {
        "file": where,
        "sha256": hashlib.sha256(data).hexdigest(),
        "simulated": "not stated",
        **result.recording.provenance,
    }
    recording = replace(result.recording, provenance=provenance)
    result = replace(result, recording=recording, format=result.format or file_format.name)
    if is_log:
        result = inspect_log(apply_options(result, options))
    else:
        # Checks are last, so that the user's repairs are included.
        result = inspect_stand(apply_options(remove_spikes(repair_time_order(result)), options))
    if options.propeller is not None:
        result = replace(result, propeller=options.propeller)
    if options.hover_kg is not None:
        result = extract_hover_points(result, options.hover_kg)
    return mark_windows(result, options.over, options.near_m)


def apply_options(result: ImportResult, options: ImportOptions) -> ImportResult:
    """Return the import with the user's repairs of its channels.

    Quantities that the stand derived from repaired channels are dropped, with a finding.
    """

    def repaired(name: str, values: Array, what: str, message: str) -> ImportResult:
        finding = Finding("repaired", what, message, name)
        return result.with_values(name, values).with_findings([finding])

    for name in options.flip:
        values = -result.recording.column(name)
        result = repaired(name, values, "wrong sign", "sign reversed by --flip")
    for name in options.tare:
        zero = estimate_zero(result.recording, name)
        if zero is None:
            raise InputError(
                f"--tare {name}: no row at rest and too few speeds to extrapolate; map the channel "
                f"with a column map"
            )
        message = f"{zero.value:.6g} subtracted by --tare, its reading {zero.where}"
        result = repaired(name, result.recording.column(name) - zero.value, "untared", message)
    for text in options.scale:
        name, sign, ratio = (part.strip() for part in text.partition("="))
        try:
            factor = float(Fraction(ratio))
        except (ValueError, ZeroDivisionError, OverflowError):
            factor = 0.0
        if not sign or not isfinite(factor) or factor == 0.0:
            raise InputError(f"--scale {text!r}: write it as CHANNEL=FACTOR, for example rpm1=1/6")
        values = factor * result.recording.column(name)
        result = repaired(name, values, "scale", f"multiplied by {ratio} by --scale")
    names = (*options.flip, *options.tare, *(text.partition("=")[0] for text in options.scale))
    changed = dict.fromkeys(name.strip() for name in names)
    dependent = [other for name in changed for other in dependent_quantities(name)]
    stale = [name for name in dict.fromkeys(dependent) if name in result.recording]
    if not stale:
        return result
    text = f"derived by the stand before the repair of {', '.join(changed)}: {', '.join(stale)}"
    result = replace(result, recording=result.recording.drop(stale))
    return result.with_findings([Finding("left out", "stale columns", text, count=len(stale))])


def _select_format(head: bytes, options: ImportOptions) -> Format:
    """Return the format of a file with these first bytes; a user's map has priority."""
    return BY_MAP if options.columns is not None else detect_format(head) or BY_NAMES


def _explain_folder(folder: Path, options: ImportOptions) -> str:
    """Return the message for a folder, with the command if it has files that can be imported."""
    entries = sorted(folder.iterdir())
    importable = [path for path in entries if path.is_file() and _can_import(path, options)]
    if not importable:
        subfolders = [f"{path}/" for path in entries if path.is_dir()][:MAX_LISTED]
        remedy = f"look into {', '.join(subfolders)}" if subfolders else "name a log or a table"
        return f"this is a folder, and none of its files is known; {remedy}"
    names = [shlex.quote(str(path)) for path in importable[:MAX_LISTED]]
    omitted = f" (and {len(importable) - MAX_LISTED} more)" if len(importable) > MAX_LISTED else ""
    return f"this is a folder; name files in it: benchtool import {' '.join(names)}{omitted}"


def _can_import(path: Path, options: ImportOptions) -> bool:
    """Return whether a file begins like a log, or like a table with known columns."""
    try:
        with open_file(path) as file:
            head = file.read(HEAD_BYTES)
        if len(head) == HEAD_BYTES:
            head = head[: head.rfind(b"\n") + 1] or head
        file_format = _select_format(head, options)
        if file_format.kind == "table":
            file_format.read(parse_rows(head, str(path)), options)
    except (OSError, InputError):
        return False
    return True
