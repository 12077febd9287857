"""Logs of a flown ArduCopter 4.6.2 against the ground truth of its simulator."""

from __future__ import annotations

import gzip
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchtool.data.formats.ardupilot import read_dataflash
from benchtool.data.formats.formats import import_bytes
from benchtool.data.repairs.import_result import ImportOptions, ImportResult
from tests.unit.data.flight_logs import dataflash, hop
from tests.unit.data.stand_logs import found

FLIGHTS = (
    *("calm_1", "calm_2_esc", "wind3_north", "wind5_east_gusty", "motor1_weak10_esc"),
    *("wind9_gusty", "battery_sag", "mass_plus25", "gyro_bias_midair", "accel_bias", "trim_2deg"),
)


DECEIVED = {"gyro_bias_midair", "accel_bias"}
"""Flights whose sensors were off, so that the autopilot's own attitude is."""


@pytest.fixture(scope="module")
def flights(reference_data):
    folder = reference_data.parent / "peers" / "flights"
    if not folder.is_dir():
        pytest.skip("there are no recorded flights in the reference data")
    return folder


def flown(folder: Path, name: str) -> tuple[bytes, ImportResult, dict[str, Any]]:
    data = gzip.decompress((folder / f"{name}.BIN.gz").read_bytes())
    truth: dict[str, Any] = json.loads((folder / "truth.json").read_text())["flights"][name]
    return data, import_bytes(data, f"{name}.BIN", ImportOptions()), truth


def finite(read: ImportResult, channel: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the times in seconds since boot and the values of a channel where it has any."""
    column = read.recording.column(channel)
    rows = np.isfinite(column)
    return 1e-6 * read.recording.column("device_time_us")[rows], column[rows]


@pytest.mark.parametrize("name", FLIGHTS)
def test_a_flight_is_read_at_the_rate_it_was_logged(flights, name):
    data, read, truth = flown(flights, name)
    apart_deg = 1.0 if name in DECEIVED else 0.5
    time_s, roll = finite(read, "roll_rad")
    gyro_s, gyro = finite(read, "gyro_rad_s")
    # ATT came at 10 Hz; ANG comes with the gyro, at 50 or 100 Hz.
    assert time_s.size == finite(read, "theta_ref_rad")[1].size
    assert abs(time_s.size - gyro_s.size) <= 1  # the log ends between two messages of a step
    assert np.median(np.diff(time_s)) == pytest.approx(0.02 if "_esc" in name else 0.01, rel=0.03)
    assert time_s[-1] - time_s[0] == pytest.approx(truth["seconds"], abs=1.0)
    assert float(np.degrees(np.abs(roll).max())) == pytest.approx(
        truth["greatest_roll_deg"], abs=apart_deg
    )
    (finding,) = found(read, "attitude")
    assert finding.words.startswith("ANG, ")
    # The attitude is that of the simulator, as far as the sensors were right.
    simulated = read_dataflash(data, frozenset({"SIM"}))["SIM"]
    assert simulated.time_us is not None
    true_s, true_roll = 1e-6 * simulated.time_us, np.radians(simulated.numbers("Roll"))
    missed = roll - np.interp(time_s, true_s, true_roll)
    assert name in DECEIVED or float(np.degrees(np.sqrt(np.mean(missed**2)))) < apart_deg
    # Controller outputs have the rate of the gyro, and pitch the sign of theta.
    for axis in ("pitch", "roll", "yaw", "throttle"):
        share = finite(read, f"{axis}_command_share")[1]
        assert abs(share.size - gyro.size) <= 1
        assert float(np.abs(share).max()) <= 1.0
    volts = finite(read, "voltage_V")[1]
    assert float(volts[0]) == pytest.approx(truth["volts"][0], abs=0.3)


def test_speeds_of_tachometers_come_from_each_sensor_in_good_health():
    items = [item for item in hop(1.0) if item[0] != "ESC"]
    for tick in range(10):
        at = 5_000_000 + 100_000 * tick
        items.append(("RPM", (at, 0, 5000.0 + tick, 0.9, int(tick != 4))))
        items.append(("RPM", (at, 1, 6000.0 + tick, 0.9, 1)))
    read = import_bytes(dataflash(items), "log.bin", ImportOptions())
    np.testing.assert_array_equal(
        finite(read, "rpm1")[1], [5000.0 + tick for tick in range(10) if tick != 4]
    )
    np.testing.assert_array_equal(finite(read, "rpm2")[1], 6000.0 + np.arange(10.0))
    assert {item.kind for item in found(read, "rpm")} == {"read as", "repaired"}
