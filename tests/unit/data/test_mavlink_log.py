"""Telemetry logs against mavutil, and frames made by pymavlink."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from benchtool.data.formats.formats import import_bytes
from benchtool.data.formats.mavlink_log import AutopilotClock
from benchtool.data.repairs.import_result import ImportOptions, ImportResult
from tests.unit.data.stand_logs import found

START_US = 1_700_000_000_000_000


def tlog(items: list[tuple[int, Any]], *, system: int = 1, version: int = 2) -> bytes:
    """Give a log of messages, each with the host's delay in microseconds after boot."""
    sender = dialect.MAVLink(None, srcSystem=system, srcComponent=1)
    parts = []
    for at_us, message in items:
        frame = message.pack(sender, force_mavlink1=version == 1)
        parts.append(struct.pack(">Q", START_US + at_us) + frame)
    return b"".join(parts)


def attitude(boot_ms: int, pitch: float = 0.1) -> Any:
    return dialect.MAVLink_attitude_message(boot_ms, 0.0, pitch, 1.0, 0.0, -0.25, 0.0)


def hop() -> list[tuple[int, Any]]:
    """Give ten seconds of a quadrotor: attitude at 10 Hz, each message late by another delay."""
    items: list[tuple[int, Any]] = []
    for tick in range(100):
        boot_ms = 5000 + 100 * tick
        late = 1000 * boot_ms + 1000 * (tick * 37 % 50)
        items.append((late, attitude(boot_ms, 0.001 * tick)))
        outputs = dialect.MAVLink_servo_output_raw_message(
            1000 * boot_ms + 7, 0, 1500, 1510, 1520, 1530, 0, 0, 0, 0
        )
        items.append((late + 100, outputs))
        speeds = dialect.MAVLink_esc_telemetry_1_to_4_message(
            [0] * 4, [0] * 4, [0] * 4, [0] * 4, [5000, 5001, 5002, 5003], [0] * 4
        )
        items.append((late + 200, speeds))
        sensor = dialect.MAVLink_distance_sensor_message(boot_ms, 10, 1000, 45, 0, 0, 25, 0)
        items.append((late + 300, sensor))
    return items


def finite_values(read: ImportResult, name: str) -> np.ndarray:
    column = read.recording.column(name)
    return column[np.isfinite(column)]


@pytest.mark.parametrize("version", [1, 2])
def test_messages_become_channels_on_the_autopilots_clock(version):
    items = [item for item in hop() if version == 2 or item[1].id < 256]
    read = import_bytes(tlog(items, version=version), "hop.tlog", ImportOptions())
    assert read.tally.is_balanced
    assert read.tally.kept == len(items)
    recording = read.recording
    rows = np.isfinite(recording.column("theta_rad"))
    np.testing.assert_allclose(recording.column("time_s")[rows], 0.1 * np.arange(100), atol=1e-9)
    np.testing.assert_allclose(finite_values(read, "theta_rad"), -0.001 * np.arange(100), rtol=1e-6)
    assert set(finite_values(read, "gyro_rad_s")) == {0.25}
    at = np.isfinite(recording.column("pwm1_us"))
    np.testing.assert_allclose(
        recording.column("time_s")[at] - 7e-6, 0.1 * np.arange(100), atol=1e-9
    )
    assert set(finite_values(read, "pwm4_us")) == {1530.0}
    assert set(finite_values(read, "distance_m")) == {0.45}
    if version == 2:
        assert [set(finite_values(read, f"rpm{n}")) for n in (1, 4)] == [{5000.0}, {5003.0}]


def test_a_cut_log_and_garbage_inside():
    items = hop()
    data = tlog(items)
    cut = import_bytes(data[:-3], "hop.tlog", ImportOptions())
    assert cut.tally.is_balanced
    assert (cut.tally.refused, cut.tally.kept) == (1, len(items) - 1)
    assert f"byte {len(data) - 3:,}" in found(cut, "cut off")[0].words
    middle = len(tlog(items[:40]))
    hurt = import_bytes(
        data[:middle] + b"\xfd\x00garbage" * 5 + data[middle:], "x.tlog", ImportOptions()
    )
    assert hurt.tally.is_balanced
    assert hurt.tally.kept >= len(items) - 1
    assert found(hurt, "corrupt bytes")


def test_a_wrong_checksum_is_refused():
    items = hop()
    data = bytearray(tlog(items))
    data[len(tlog(items[:8])) - 1] ^= 0xFF  # checksum of the eighth frame
    read = import_bytes(bytes(data), "hop.tlog", ImportOptions())
    assert read.tally.refused == 1
    assert read.tally.kept == len(items) - 1
    assert found(read, "corrupt frames")[0].count == 1


def test_the_vehicle_is_known_from_others():
    other = tlog([(6_000_000 + 1000 * i, attitude(6000 + i, 0.9)) for i in range(5)], system=9)
    read = import_bytes(tlog(hop()) + other, "two.tlog", ImportOptions())
    assert read.recording.provenance["device"] == "MAVLink system 1, component 1"
    assert "9/1 left out" in found(read, "other systems")[0].words
    assert read.tally.not_needed == 5


def test_a_reboot_goes_on_in_time():
    items = [(1_000_000 * i, attitude(60_000 + 1000 * i)) for i in range(5)]
    items += [(10_000_000 + 1_000_000 * i, attitude(2_000 + 1000 * i)) for i in range(5)]
    read = import_bytes(tlog(items), "boot.tlog", ImportOptions())
    np.testing.assert_allclose(
        read.recording.column("time_s"), [0, 1, 2, 3, 4, 10, 11, 12, 13, 14], atol=1e-9
    )
    assert found(read, "time starts anew")[0].count == 1


def test_a_count_of_32_bits_wraps():
    host = np.arange(10, dtype=np.int64) * 60_000_000
    boot_ms = 4_290_000.0 + 60_000.0 * np.arange(10)
    clock = AutopilotClock(host, boot_ms)
    wrapped = (1000.0 * boot_ms + 5.0) % 2.0**32
    np.testing.assert_array_equal(clock.time_from_wrapped_us(host, wrapped), 1000.0 * boot_ms + 5.0)
