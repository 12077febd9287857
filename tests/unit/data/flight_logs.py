"""DataFlash and telemetry logs made here, record by record, with known numbers."""

from __future__ import annotations

import struct
from collections.abc import Sequence

LAYOUTS: dict[str, tuple[str, str]] = {
    "ATT": ("QccccCC", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw"),
    "IMU": ("QBfff", "TimeUS,I,GyrX,GyrY,GyrZ"),
    "RATE": ("Qffffff", "TimeUS,RDes,R,PDes,P,YDes,Y"),
    "RCOU": ("QHHHH", "TimeUS,C1,C2,C3,C4"),
    "ESC": ("QBfffH", "TimeUS,Instance,RPM,Volt,Curr,Err"),
    "RPM": ("QBffB", "TimeUS,I,RPM,Qual,H"),
    "RFND": ("QBCBB", "TimeUS,Instance,Dist,Stat,Orient"),
    "BAT": ("QBff", "TimeUS,Inst,Volt,Curr"),
    "PARM": ("QNff", "TimeUS,Name,Value,Default"),
    "POS": ("QLLe", "TimeUS,Lat,Lng,Alt"),
    "MSG": ("QZ", "TimeUS,Message"),
}
CODES = {
    "Q": "Q",
    "B": "B",
    "f": "f",
    "c": "h",
    "C": "H",
    "H": "H",
    "L": "i",
    "e": "i",
    "N": "16s",
    "Z": "64s",
}
NUMBERS = {name: number for number, name in enumerate(LAYOUTS, 140)}

Record = tuple[str, Sequence[float | bytes]]


def packer(name: str) -> struct.Struct:
    return struct.Struct("<" + "".join(CODES[letter] for letter in LAYOUTS[name][0]))


def fmt(name: str) -> bytes:
    letters, columns = LAYOUTS[name]
    texts = (name.encode(), letters.encode(), columns.encode())
    length = 3 + packer(name).size
    return b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", NUMBERS[name], length, *texts)


def record(name: str, values: Sequence[float | bytes]) -> bytes:
    return b"\xa3\x95" + bytes([NUMBERS[name]]) + packer(name).pack(*values)


def dataflash(records: Sequence[Record]) -> bytes:
    """Give a binary log: the formats, then the records."""
    head = b"\xa3\x95\x80" + struct.pack(
        "<BB4s16s64s", 128, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns"
    )
    return head + b"".join(map(fmt, LAYOUTS)) + b"".join(record(*item) for item in records)


def text_log(records: Sequence[Record]) -> str:
    """Give the same log as text, as ArduPilot's tools write it."""
    lines = ["FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns"]
    for name, (letters, columns) in LAYOUTS.items():
        length = 3 + packer(name).size
        lines.append(f"FMT, {NUMBERS[name]}, {length}, {name}, {letters}, {columns}")
    divisors = {"c": 100.0, "C": 100.0, "e": 100.0, "L": 1e7}
    for name, values in records:
        cells = [
            value.decode() if isinstance(value, bytes) else str(_shown(value, divisors.get(letter)))
            for letter, value in zip(LAYOUTS[name][0], values, strict=True)
        ]
        lines.append(", ".join([name, *cells]))
    return "\n".join(lines) + "\n"


def _shown(value: float, divisor: float | None) -> float:
    return value if divisor is None else value / divisor


def hop(seconds: float = 4.0) -> list[Record]:
    """Give a short flight of a quadrotor with ESC telemetry over a step in the ground."""
    items: list[Record] = [("MSG", (0, b"ArduCopter V4.5.7"))]
    for channel, function in ((1, 33), (2, 36), (3, 34), (4, 35)):
        name = f"SERVO{channel}_FUNCTION".encode()
        items.append(("PARM", (0, name, float(function), 0.0)))
    for tick in range(int(100 * seconds)):
        at = 5_000_000 + 10_000 * tick
        items.append(("IMU", (at, 0, 0.01 * tick, 0.5 - 0.001 * tick, 0.0)))
        items.append(("IMU", (at, 1, 9.0, 9.0, 9.0)))
        items.append(("RATE", (at, 0.0, 1.0, 2.0, 3.0, 0.0, 0.0)))
        if tick % 4 == 0:
            items.append(("ATT", (at + 3, 0, 12, 150, 100 + tick, 0, 35999)))
            items.append(("RCOU", (at + 4, 1500, 1510, 1520, 1530)))
        if tick % 10 == 0:
            items.extend(("ESC", (at + 5, n, 5000.0 + n, 15.5, 3.25, 0)) for n in range(4))
            far = 200 if tick < 100 or tick >= 300 else 30
            items.append(("RFND", (at + 6, 0, far, 4, 25)))
            items.append(("RFND", (at + 6, 1, 777, 4, 0)))
            items.append(("BAT", (at + 7, 0, 15.5, 12.25)))
            items.append(("POS", (at + 8, 481234567, 117654321, 51234)))
    return items
