"""Print what imports cost beside the libraries that read the same files, as ratios.

The aims: a CSV of 1,000,000 rows in at most 2.0 times pandas.read_csv; a DataFlash log at least 5
times as fast as iterating pymavlink's DFReader over it; a .ulg in at most 1.3 times pyulog; a .tlog
in at most 1.2 times mavutil. Real logs are read where BENCHTOOL_REFERENCE_DATA names some, repeated
to a measurable length; the others are made here.
"""

from __future__ import annotations

import argparse
import os
import struct
import tempfile
from collections.abc import Callable
from pathlib import Path
from time import perf_counter

import numpy as np

from benchtool.data.formats.formats import import_file


def best(work: Callable[[], object], times: int = 3) -> float:
    """Return the shortest of some runs: s."""
    spent = []
    for _ in range(times):
        begun = perf_counter()
        work()
        spent.append(perf_counter() - begun)
    return min(spent)


def in_turns(
    plain: Callable[[], object], ours: Callable[[], object], times: int
) -> tuple[float, float]:
    """Return the shortest of runs in turns, so that a busy machine hurts both alike: s."""
    pairs = [(best(plain, 1), best(ours, 1)) for _ in range(times)]
    return min(pair[0] for pair in pairs), min(pair[1] for pair in pairs)


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


def bench_csv(folder: Path, rows: int) -> None:
    """Print the cost of a long CSV, read and written."""
    import pandas as pd

    from benchtool.data.run.recording_file import write_recording

    path = folder / "stand.csv"
    write_stand_log(path, rows)
    plain_s, ours_s = in_turns(lambda: pd.read_csv(path), lambda: import_file(path), 7)
    recording = import_file(path).recording
    size_MB = path.stat().st_size / 1e6
    print(f"CSV, {rows:,} rows, {size_MB:.0f} MB: pandas.read_csv {plain_s:.2f} s")
    print(f"  import           {ours_s:.2f} s, {ours_s / plain_s:.2f} of pandas (aim 2.0)")
    for ending in ("parquet", "csv"):
        target = folder / f"out.{ending}"
        written_s = best(lambda to=target: write_recording(to, recording, {}, overwrite=True), 1)
        whole = (ours_s + written_s) / plain_s
        print(f"  written as {ending:8s}{written_s:.2f} s, {whole:.2f} of pandas with the import")


def write_dataflash(path: Path, seconds: float) -> None:
    """Write a DataFlash log as a copter at 400 Hz does: IMUs, rates, attitude, outputs, others."""
    rng = np.random.default_rng(2)
    kinds = {
        "IMU": ("QBffffffIIfBBHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz"),
        "RATE": ("Qffffffffffff", "TimeUS,RDes,R,ROut,PDes,P,POut,YDes,Y,YOut,ADes,A,AOut"),
        "ATT": ("QccccCCCCB", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,ErrRP,ErrYaw,AEKF"),
        "RCOU": ("QHHHHHHHHHHHHHH", "TimeUS," + ",".join(f"C{i}" for i in range(1, 15))),
        "XKF1": ("QBccCfffffffccce", "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD,dPD,PN,PE,PD,GX,GY,GZ,OH"),
    }
    codes = {"Q": "Q", "B": "B", "f": "f", "I": "I", "H": "H", "c": "h", "C": "H", "e": "i"}
    parts = [_fmt(128, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")]
    packers = {}
    for number, (name, (letters, columns)) in enumerate(kinds.items(), 130):
        packer = struct.Struct("<" + "".join(codes[letter] for letter in letters))
        packers[name] = (bytes((0xA3, 0x95, number)), packer, letters)
        parts.append(_fmt(number, 3 + packer.size, name, letters, columns))

    def record(name: str, time_us: int) -> bytes:
        head, packer, letters = packers[name]
        numbers = [
            float(value) if letter == "f" else int(abs(value) * 60) + 1
            for letter, value in zip(letters[1:], rng.normal(size=len(letters) - 1), strict=True)
        ]
        return head + packer.pack(time_us, *numbers)

    second = []
    for tick in range(400):
        names = ["IMU", "RATE", *(["ATT", "RCOU"] if tick % 4 == 0 else []), "XKF1"]
        second += [(name, record(name, 0)[11:], tick * 2500) for name in names]
    for whole in range(int(seconds)):
        for name, rest, at_us in second:
            parts.append(packers[name][0] + struct.pack("<Q", whole * 1_000_000 + at_us) + rest)
    path.write_bytes(b"".join(parts))


def _fmt(kind: int, length: int, name: str, letters: str, columns: str) -> bytes:
    texts = (name.encode(), letters.encode(), columns.encode())
    return b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", kind, length, *texts)


def bench_dataflash(folder: Path, seconds: float) -> None:
    """Print the cost of a DataFlash log."""
    from pymavlink.DFReader import DFReader_binary

    path = folder / "flight.bin"
    write_dataflash(path, seconds)

    def iterate() -> int:
        reader = DFReader_binary(str(path))
        count = 0
        while reader.recv_msg() is not None:
            count += 1
        return count

    size_MB = path.stat().st_size / 1e6
    plain_s, ours_s = best(iterate, 1), best(lambda: import_file(path))
    print(f"DataFlash, {size_MB:.0f} MB: DFReader {plain_s:.2f} s, {size_MB / plain_s:.1f} MB/s")
    speed = size_MB / ours_s
    print(
        f"  import {ours_s:.2f} s, {speed:.1f} MB/s, {plain_s / ours_s:.1f} times DFReader (aim 5)"
    )


def bench_logs(reference: Path) -> None:
    """Print the cost of the reference logs."""
    from pymavlink import mavutil
    from pyulog import ULog

    for path in sorted((reference / "logs").glob("*.ulg")):
        plain_s, ours_s = in_turns(
            lambda at=path: ULog(str(at)), lambda at=path: import_file(at), 15
        )
        print(f"{path.name}: pyulog {plain_s * 1e3:.0f} ms, import {ours_s * 1e3:.0f} ms, ", end="")
        print(f"{ours_s / plain_s:.2f} of pyulog (aim 1.3)")
    for path in sorted((reference / "logs").glob("*.tlog")):

        def iterate(at: Path = path) -> None:
            log = mavutil.mavlink_connection(str(at))
            while log.recv_msg() is not None:
                pass

        plain_s, ours_s = in_turns(iterate, lambda at=path: import_file(at), 5)
        print(
            f"{path.name}: mavutil {plain_s * 1e3:.0f} ms, import {ours_s * 1e3:.0f} ms, ", end=""
        )
        print(f"{ours_s / plain_s:.2f} of mavutil (aim 1.2)")


def main() -> None:
    """Print all of it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, default=1_000_000)
    parser.add_argument("--seconds", type=float, default=120.0, help="of the DataFlash log")
    told = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        bench_csv(Path(name), told.rows)
        bench_dataflash(Path(name), told.seconds)
    if reference := os.environ.get("BENCHTOOL_REFERENCE_DATA"):
        bench_logs(Path(reference))
    else:
        print("BENCHTOOL_REFERENCE_DATA is not set: no .ulg or .tlog measured")


if __name__ == "__main__":
    main()
