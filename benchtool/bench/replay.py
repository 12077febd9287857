"""Replay of a run as a bench (`replay:RUN` addresses).

It only supports reading. Every command is rejected except stop, which is a no-op. Time is virtual:
`read(10.0)` returns the next ten seconds at once.
"""

from __future__ import annotations

import csv
import os
from pathlib import Path
from typing import NoReturn

import numpy as np

from benchtool.bench.bench import ContextBench, DeviceInfo, Readings
from benchtool.bench.drivers import ReplayAddress
from benchtool.core.channel import Channel, unit_from_name
from benchtool.core.errors import CommandRefused, FileFormatError, LinkLost
from benchtool.core.text import pluralize
from benchtool.core.toml_text import parse_json
from benchtool.core.units import Array
from benchtool.core.user_file import MAX_DATA_BYTES, MAX_METADATA_BYTES, read_text

_META_COLUMNS = ("time_s", "device_time_us", "point", "phase")


class ReplayBench(ContextBench):
    """Bench that plays recorded samples and accepts no commands."""

    def __init__(
        self, identity: DeviceInfo, time_s: Array, device_time_us: Array, values: Array
    ) -> None:
        self._identity, self.address = identity, identity.address
        self._time_s = time_s
        self._device_time_us = device_time_us
        self._values = values
        self._now_s = float(time_s[0]) if len(time_s) else 0.0
        self._next = 0
        self._open = False

    def now_s(self) -> float:
        return self._now_s

    def open(self) -> None:
        self._open = True

    def close(self) -> None:
        self._open = False

    def set_pwm(self, pwm_us: Array) -> None:
        self._reject("pwm")

    def stop(self) -> None:
        """No-op; a recording has no motors to stop."""

    def move_plate(self, z_m: float, x_m: float = 0.0, tilt_rad: float = 0.0) -> None:
        self._reject("plate")

    def tare(self) -> None:
        self._reject("tare")

    def set_rate(self, rate_Hz: float) -> None:
        self._reject("rate")

    def read(self, timeout_s: float) -> Readings:
        if not self._open:
            raise LinkLost(f"{self.address} is not open; call open() first")
        if self._next >= len(self._time_s):
            raise LinkLost(
                f"{self.address} ends after "
                f"{pluralize(len(self._time_s), 'sample')}; there are no more samples"
            )
        self._now_s += timeout_s
        end = int(np.searchsorted(self._time_s, self._now_s, side="right"))
        rows = slice(self._next, max(end, self._next))
        self._next = rows.stop
        return Readings(self._time_s[rows], self._device_time_us[rows], self._values[rows])

    def _reject(self, command: str) -> NoReturn:
        raise CommandRefused(command, "a replay accepts no commands; use the address of a bench")


def open_replay(address: ReplayAddress) -> ReplayBench:
    """Return the bench of `samples.csv` of a run folder, or of a file in that format, not open."""
    run = Path(address.run)
    path = run / "samples.csv" if os.path.isdir(run) else run
    names, table = _read_samples(path, follow=path is run)
    columns = dict(zip(names, table.T, strict=True))
    for name in _META_COLUMNS[:2]:
        if name not in columns:
            raise FileFormatError(str(path), f"column {name} is missing; use samples of a run")
    channels = tuple(
        Channel(name, unit_from_name(name)) for name in names if name not in _META_COLUMNS
    )
    time_s = columns["time_s"]
    identity = _build_device_info(address.text, path, channels, time_s)
    values = table[:, [names.index(channel.name) for channel in channels]]
    return ReplayBench(identity, time_s, columns["device_time_us"], values)


def _read_samples(path: Path, *, follow: bool) -> tuple[list[str], Array]:
    """Return column names and (n, columns) numbers; text and empty cells are nan."""
    text = read_text(path, MAX_DATA_BYTES, follow=follow)
    # Text after the last line break is an incomplete row of a killed run.
    rows = csv.reader(text[: text.rfind("\n") + 1].splitlines())
    names = next(rows, [])
    table = []
    for number, row in enumerate(rows, start=2):
        where = f"{path}, line {number}"
        if len(row) != len(names):
            raise FileFormatError(where, f"{len(row)} cells, {len(names)} columns; correct the row")
        cells = [cell if name != "phase" else "" for name, cell in zip(names, row, strict=True)]
        try:
            table.append([float(cell) if cell else np.nan for cell in cells])
        except ValueError as error:
            raise FileFormatError(where, f"{error}; correct the cell") from error
    if not table:
        raise FileFormatError(str(path), "file contains no samples; use a run with samples")
    return names, np.array(table, float)


def _build_device_info(
    address: str, path: Path, channels: tuple[Channel, ...], time_s: Array
) -> DeviceInfo:
    metadata_path, metadata = path.parent / "metadata.json", {}
    if os.path.lexists(metadata_path):
        text = read_text(metadata_path, MAX_METADATA_BYTES)
        metadata = parse_json(text, str(metadata_path))
        if not isinstance(metadata, dict):
            raise FileFormatError(str(metadata_path), "not a JSON object; correct or remove it")
    device = metadata.get("device_id", "")
    step_s = float(np.median(np.diff(time_s))) if len(time_s) > 1 else 1.0
    return DeviceInfo(
        address=address,
        device_id=str(device) or f"replay-{path.parent.name}",
        firmware=str(metadata.get("firmware", "")) or "not recorded",
        protocol="replay",
        channels=channels,
        rate_Hz=1.0 / max(step_s, 1e-9),
        n_rotors=sum(channel.unit == "pwm_us" for channel in channels),
        simulated=bool(metadata.get("simulated", False)),
        moves_plate=False,
        facts={"file": str(path), "metadata": "found" if metadata else "none"},
    )
