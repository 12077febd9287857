"""Imports beside the libraries that read the same files.

Real logs are read where BENCHTOOL_REFERENCE_DATA names some; the others are made here.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchtool.core.recording import Recording
from benchtool.data.columns import find_channel
from benchtool.data.formats.formats import import_file
from benchtool.data.parquet import read_parquet, write_parquet
from benchtool.data.run.recording_file import read_mcap, write_mcap, write_recording
from tests.proof.benchmarks.rows import Row, cpu_s, in_turns
from tests.unit.data.flight_logs import LAYOUTS, Record, dataflash


def write_stand_log(path: Path, rows: int) -> None:
    """Write a Series-1580 log with the many digits that its program writes."""
    rng = np.random.default_rng(1)
    header = (
        "Time (s),ESC signal (µs),Servo 1 (µs),Servo 2 (µs),Servo 3 (µs),AccX (g),AccY (g),"
        "AccZ (g),Torque (N·m),Thrust (gf),Voltage (V),Current (A),Motor Electrical Speed (RPM),"
        "Motor Optical Speed (RPM),Electrical Power (W),Mechanical Power (W),Motor Efficiency (%),"
        "Propeller Mech. Efficiency (gf/W),Overall Efficiency (gf/W),Vibration (g),App message,\n"
    )
    block = 10_000
    lines = []
    for _ in range(block):
        a, b, c, d = rng.random(4).tolist()
        lines.append(
            f",{1000 + int(900 * a)},,,,{a},{b},{-c},{0.01 * d},{300 * a},{11.0 + b},{5 * c},"
            f"{int(9000 * a)},0,{50 * c},{30 * d},{60 + a},{7 + b},{4 + c},{0.1 * d},,\n"
        )
    with open(path, "w", encoding="utf-8-sig") as file:
        file.write(header)
        for row in range(rows):
            file.write(f"{row * 0.01}{lines[row % block]}")


def csv_rows(folder: Path, count: int) -> Iterator[Row]:
    """Yield a long CSV, read and written."""
    import pandas as pd

    path = folder / "stand.csv"
    write_stand_log(path, count)
    ours, plain = in_turns(1, lambda: import_file(path), lambda: pd.read_csv(path))
    work = f"import of a CSV, {count:,} rows, {path.stat().st_size / 1e6:.0f} MB"
    yield Row(work, ours, "s", plain, "pandas.read_csv", 2.0, of_peer=True)
    recording = import_file(path).recording
    for ending in ("parquet", "csv"):
        target = folder / f"out.{ending}"
        written_s = cpu_s(lambda: write_recording(target, recording, {}, overwrite=True))  # noqa: B023
        yield Row(f"the same, written as {ending}", written_s, "s")


def write_dataflash(path: Path, seconds: float) -> None:
    """Write a DataFlash log as a copter at 400 Hz does: IMU, rates, attitude, outputs, ESCs."""
    rng = np.random.default_rng(2)

    def record(name: str, tick: int) -> Record:
        letters = LAYOUTS[name][0][1:]
        values = [
            float(value) if letter == "f" else min(int(abs(value) * 60) + 1, 255)
            for letter, value in zip(letters, rng.normal(size=len(letters)), strict=True)
        ]
        return name, (2500 * tick, *values)

    often, seldom = ("IMU", "RATE"), ("IMU", "RATE", "ATT", "RCOU", "ESC", "RFND")
    records = [
        record(name, tick)
        for tick in range(int(400 * seconds))
        for name in (often if tick % 4 else seldom)
    ]
    path.write_bytes(dataflash(records))


def dataflash_rows(folder: Path, seconds: float) -> Iterator[Row]:
    """Yield a DataFlash log."""
    from pymavlink.DFReader import DFReader_binary

    path = folder / "flight.bin"
    write_dataflash(path, seconds)

    def iterate() -> None:
        reader = DFReader_binary(str(path))
        while reader.recv_msg() is not None:
            pass

    size_MB = path.stat().st_size / 1e6
    import_file(path)
    ours, plain = in_turns(1, lambda: import_file(path), iterate, warm=False)
    work = f"import of a DataFlash log, {size_MB:.0f} MB"
    yield Row(work, size_MB / ours, "MB/s", size_MB / plain, "DFReader", 5.0, of_peer=True)


def log_rows(folder: Path, quick: bool) -> Iterator[Row]:
    """Yield the reference logs."""
    from pymavlink import mavutil
    from pyulog import ULog

    def read_tlog(path: Path) -> None:
        log = mavutil.mavlink_connection(str(path))
        while log.recv_msg() is not None:
            pass

    for ending, peer_name, read, limit, rounds in (
        ("ulg", "pyulog", lambda path: ULog(str(path)), 1.3, 15),
        ("tlog", "mavutil", read_tlog, 1.2, 5),
    ):
        for path in sorted(folder.glob(f"*.{ending}")):
            ours, plain = in_turns(
                1 if quick else rounds,
                lambda: import_file(path),  # noqa: B023
                lambda: read(path),  # noqa: B023
            )
            yield Row(f"import of {path.name}", ours, "s", plain, peer_name, limit, of_peer=True)


def mcap_rows(folder: Path, count: int) -> Iterator[Row]:
    """Yield MCAP written and read beside Parquet; what comes back is compared."""
    names = ("time_s", "thrust_N", "rpm1", "voltage_V")
    values = np.round(np.random.default_rng(1).normal(size=(count, len(names))), 4)
    values[:, 0] = np.arange(count) / 1000.0
    recording = Recording(tuple(map(find_channel, names)), values)
    mcap, parquet = folder / "samples.mcap", folder / "samples.parquet"
    ours, peer = in_turns(
        1, lambda: write_mcap(mcap, recording), lambda: write_parquet(parquet, recording),
        warm=False,
    )  # fmt: skip
    yield Row(f"MCAP, write {count:,} rows", ours, "s", peer, "Parquet")
    ours, peer = in_turns(1, lambda: read_mcap(mcap), lambda: read_parquet(parquet))
    yield Row(f"MCAP, read {count:,} rows", ours, "s", peer, "Parquet")
    assert read_mcap(mcap).values.tobytes() == values.tobytes()


def rows(quick: bool) -> Iterator[Row]:
    """Yield the rows of every format."""
    with tempfile.TemporaryDirectory() as name:
        yield from csv_rows(Path(name), 10_000 if quick else 1_000_000)
        yield from mcap_rows(Path(name), 1000 if quick else 1_000_000)
        yield from dataflash_rows(Path(name), 1.0 if quick else 120.0)
    if reference := os.environ.get("BENCHTOOL_REFERENCE_DATA"):
        yield from log_rows(Path(reference) / "logs", quick)
