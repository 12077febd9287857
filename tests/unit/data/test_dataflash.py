"""ArduPilot logs: numbers equal to those of DFReader, and recovery of corrupt logs."""

from __future__ import annotations

from collections.abc import Iterator
from math import radians
from typing import Any

import numpy as np
import pytest
from pymavlink.DFReader import DFReader, DFReader_binary, DFReader_text

from benchtool.data.formats.formats import import_bytes, import_file
from benchtool.data.repairs.import_result import ImportOptions, ImportResult
from tests.unit.data.flight_logs import LAYOUTS, dataflash, hop, record, text_log
from tests.unit.data.stand_logs import found

SCALES = {
    "theta_rad": ("ATT", "Pitch", -1.0, True),
    "theta_ref_rad": ("ATT", "DesPitch", -1.0, True),
    "roll_rad": ("ATT", "Roll", 1.0, True),
    "yaw_rad": ("ATT", "Yaw", 1.0, True),
    "gyro_rad_s": ("IMU", "GyrY", -1.0, False),
    "roll_rate_rad_s": ("IMU", "GyrX", 1.0, False),
    "voltage_V": ("BAT", "Volt", 1.0, False),
    "current_A": ("BAT", "Curr", 1.0, False),
}


def messages(reader: DFReader) -> Iterator[Any]:
    """Iterate over all that DFReader reads, and close its file."""
    with reader:
        while (message := reader.recv_msg()) is not None:
            yield message
    reader.filehandle.close()


def check_against_dfreader(read: ImportResult, reader: DFReader) -> None:
    """Compare every value of `SCALES` with what DFReader iterates over."""
    selected: dict[str, list[tuple[int, float]]] = {name: [] for name in SCALES}
    for message in messages(reader):
        for name, (kind, field, sign, angle) in SCALES.items():
            if message.get_type() != kind or getattr(message, "I", 0) != 0:
                continue
            value = getattr(message, field)
            selected[name].append((message.TimeUS, sign * (radians(value) if angle else value)))
    compared = 0
    for name, pairs in selected.items():
        if not pairs:
            assert name not in read.recording
            continue
        column = read.recording.column(name)
        rows = np.isfinite(column)
        times, values = zip(*pairs, strict=True)
        np.testing.assert_array_equal(read.recording.column("device_time_us")[rows], times)
        np.testing.assert_array_equal(column[rows], values)
        compared += len(values)
    assert compared > 100


def test_numbers_are_dfreaders(tmp_path):
    path = tmp_path / "hop.bin"
    path.write_bytes(dataflash(hop()))
    read = import_file(path)
    assert read.format == "ArduPilot DataFlash"
    assert read.tally.is_balanced
    check_against_dfreader(read, DFReader_binary(str(path)))


def test_a_text_log_holds_the_same(tmp_path):
    path = tmp_path / "hop.log"
    path.write_text(text_log(hop()))
    read = import_file(path)
    assert read.format == "ArduPilot DataFlash text"
    check_against_dfreader(read, DFReader_text(str(path)))
    binary = import_bytes(dataflash(hop()), "hop.bin", ImportOptions()).recording
    np.testing.assert_allclose(read.recording.values, binary.values, rtol=1e-6)


def test_motors_speeds_and_distance_find_their_channels():
    recording = import_bytes(dataflash(hop()), "hop.bin", ImportOptions()).recording
    first = {name: recording.column(name) for name in recording.names}
    first = {name: values[np.isfinite(values)][0] for name, values in first.items()}
    # SERVO2 drives motor 4, and ESC 1 stands on that channel.
    assert [first[f"pwm{motor}_us"] for motor in (1, 2, 3, 4)] == [1500.0, 1520.0, 1530.0, 1510.0]
    assert [first[f"rpm{motor}"] for motor in (1, 2, 3, 4)] == [5000.0, 5002.0, 5003.0, 5001.0]
    assert first["distance_m"] == 2.0
    assert first["gyro_ref_rad_s"] == -radians(2.0)
    assert recording.provenance["device"] == "ArduCopter V4.5.7"


def test_windows_of_the_sensor_and_of_the_user():
    read = import_bytes(dataflash(hop()), "hop.bin", ImportOptions(near_m=0.5))
    (window,) = read.windows
    assert (window.rotor, window.source) == (0, "distance sensor")
    assert window.start_s == pytest.approx(1.0, abs=0.02)
    assert window.end_s == pytest.approx(2.9, abs=0.02)
    time_s = read.recording.column("time_s")
    covered = read.recording.column("coverage3") == 1.0
    assert set(time_s[covered] >= window.start_s) == {True}
    assert covered.any()
    assert not covered.all()


def test_a_cut_log_gives_what_is_whole():
    data = dataflash(hop())
    whole = import_bytes(data, "hop.bin", ImportOptions())
    cut = import_bytes(data[:-9], "hop.bin", ImportOptions())
    assert cut.tally.is_balanced
    assert cut.tally.refused == 1
    assert f"byte {len(data) - 9:,}" in found(cut, "cut off")[0].words
    assert len(whole.recording) - len(cut.recording) <= 1


def test_corrupt_bytes_are_passed_over_and_counted():
    records = hop()
    middle = len(dataflash(records[:200]))
    data = dataflash(records)
    hurt = data[:middle] + b"\x00" * 37 + data[middle:]
    read = import_bytes(hurt, "hop.bin", ImportOptions())
    np.testing.assert_array_equal(
        read.recording.values, import_bytes(data, "hop.bin", ImportOptions()).recording.values
    )
    (finding,) = found(read, "corrupt bytes")
    assert "37 bytes in 1 place" in finding.words
    assert f"byte {middle:,}" in finding.words


def test_a_records_head_inside_a_body_is_no_record():
    records = hop()
    # These four floats hold 0xA3 0x95 and ATT's number.
    trap = np.frombuffer(b"\xa3\x95\x8c\x3f" * 4, "<f4").tolist()
    records.insert(50, ("RATE", (5_000_001, *trap, 0.0, 0.0)))
    read = import_bytes(dataflash(records), "hop.bin", ImportOptions())
    assert read.tally.total == len(records) + 1 + len(LAYOUTS)
    assert found(read, "corrupt bytes") == []


def test_a_stray_time_is_refused():
    data = dataflash(hop()) + record("ATT", (1 << 60, 0, 0, 0, 0, 0, 0))
    read = import_bytes(data, "hop.bin", ImportOptions())
    assert found(read, "stray time")[0].count == 1
    assert read.tally.is_balanced
    assert read.recording.column("time_s")[-1] < 10.0
