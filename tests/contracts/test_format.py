"""The contract of every format in the registry."""

from __future__ import annotations

import re
import struct
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from benchtool.data.formats.formats import FORMATS, detect_format, import_bytes
from benchtool.data.repairs.import_result import ImportOptions
from tests.unit.data.flight_logs import dataflash, hop, text_log
from tests.unit.data.stand_logs import log_text, steps_1580

EACH = pytest.mark.parametrize("member", FORMATS, ids=lambda member: member.name)


def ulog() -> bytes:
    """Give a PX4 log of ten attitudes."""

    def message(kind: str, body: bytes) -> bytes:
        return struct.pack("<HB", len(body), ord(kind)) + body

    head = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0)
    layout = message("F", b"vehicle_attitude:uint64_t timestamp;float[4] q;")
    added = message("A", struct.pack("<BH", 0, 7) + b"vehicle_attitude")
    rows = [
        message("D", struct.pack("<HQ4f", 7, 10_000 * tick, 1.0, 0.0, 0.01 * tick, 0.0))
        for tick in range(10)
    ]
    return head + layout + added + b"".join(rows)


def tlog() -> bytes:
    """Give a telemetry log of ten attitudes."""
    sender = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    parts = []
    for tick in range(10):
        attitude = dialect.MAVLink_attitude_message(100 * tick, 0.0, 0.01 * tick, 1.0, 0, 0, 0)
        stamp = struct.pack(">Q", 1_700_000_000_000_000 + 100_000 * tick)
        parts.append(stamp + attitude.pack(sender))
    return b"".join(parts)


SAMPLES: dict[str, tuple[str, bytes]] = {
    "ArduPilot DataFlash": ("hop.bin", dataflash(hop())),
    "ArduPilot DataFlash text": ("hop.log", text_log(hop()).encode()),
    "PX4 ULog": ("hop.ulg", ulog()),
    "MAVLink tlog": ("hop.tlog", tlog()),
    "RCbenchmark": ("steps.csv", log_text(steps_1580()).encode()),
    "Crazyflie system_id": (
        "cf.csv", b"weight[g],pwm,vbat[V],rpm1,rpm2,rpm3,rpm4\n0,0,4,0,0,0,0\n9,99,4,7,7,7,7\n",
    ),
    "UIUC static": ("apc_10x7_static.txt", b"RPM CT CP\n3000 0.09 0.06\n6000 0.10 0.05\n"),
}  # fmt: skip
"""A file of each format: its name, and its bytes."""

SAMPLED = pytest.mark.parametrize(
    "member", [item for item in FORMATS if item.name in SAMPLES], ids=lambda item: item.name
)


@EACH
def test_it_has_a_sample(member):
    assert member.name in SAMPLES, f"add a file of the format {member.name} to SAMPLES"


@SAMPLED
def test_its_sample_is_recognized_by_no_other_format(member):
    _, data = SAMPLES[member.name]
    assert [item.name for item in FORMATS if item.recognizes(data)] == [member.name]
    assert detect_format(data) is member


@SAMPLED
def test_its_sample_is_imported_and_every_row_is_counted(member):
    where, data = SAMPLES[member.name]
    read = import_bytes(data, where, ImportOptions())
    assert read.format.startswith(member.name)
    assert read.tally.is_balanced
    assert read.tally.kept > 0
    assert read.tally.unit == ("message" if member.kind == "log" else "row")
    assert set(read.sources) <= set(read.recording.names)
    assert np.isfinite(read.recording.values).any(axis=0).all()


def test_every_importer_is_registered():
    """An unregistered reader is never used: each is in `FORMATS` or a fallback."""
    folder = Path(__file__).parents[2] / "benchtool" / "data" / "formats"
    signature = re.compile(
        r"(?m)^def (\w+)\((?:data: bytes, where: str|table: TextTable, options: ImportOptions)\)"
        r" -> ImportResult:"
    )
    written = {
        name for path in folder.glob("*.py") for name in signature.findall(path.read_text("utf-8"))
    }
    assert written == {item.read.__name__ for item in FORMATS}, "add a line to FORMATS"
