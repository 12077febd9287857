"""PX4 logs against pyulog, on reference logs and on broken copies of them."""

from __future__ import annotations

from math import asin

import numpy as np
import pytest
from pyulog import ULog

from benchtool.data.formats.formats import import_file
from benchtool.data.repairs.import_result import ImportResult

PLAIN = {
    "gyro_rad_s": ("vehicle_angular_velocity", "xyz[1]", -1.0),
    "gyro_ref_rad_s": ("vehicle_rates_setpoint", "pitch", -1.0),
    "pwm1_us": ("actuator_outputs", "output[0]", 1.0),
    "motor2_share": ("actuator_motors", "control[1]", 1.0),
    "rpm3": ("esc_status", "esc[2].esc_rpm", 1.0),
    "voltage_V": ("battery_status", "voltage_v", 1.0),
}


@pytest.fixture(scope="module", params=["sample_log_small.ulg", "sample_px4_events.ulg"])
def path(request, reference_data):
    return reference_data / "logs" / request.param


def finite(read: ImportResult, name: str) -> np.ndarray:
    column = read.recording.column(name)
    return column[np.isfinite(column)]


def test_numbers_are_pyulogs(path):
    read, log = import_file(path), ULog(str(path))
    assert read.tally.is_balanced
    topics = {(item.name, item.multi_id): item.data for item in log.data_list}
    compared = 0
    for name, (topic, field, sign) in PLAIN.items():
        if (topic, 0) not in topics or name not in read.recording:
            continue
        np.testing.assert_array_equal(
            finite(read, name), sign * topics[topic, 0][field].astype(float)
        )
        compared += 1
    assert compared >= 4
    attitude = topics["vehicle_attitude", 0]
    q = np.array([attitude[f"q[{i}]"].astype(float) for i in range(4)])
    q /= np.linalg.norm(q, axis=0)
    nose_up = [asin(2.0 * (w * y - z * x)) for w, x, y, z in q.T]
    np.testing.assert_allclose(-finite(read, "theta_rad"), nose_up, atol=1e-12)
    assert read.tally.total == sum(len(item.data["timestamp"]) for item in log.data_list)
