"""RCbenchmark logs with the faults of real logs."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.core.errors import InputError
from benchtool.core.units import STANDARD_GRAVITY_M_S2
from benchtool.data.repairs import column_mapping
from tests.unit.data.stand_logs import HEADER_1580, found, imported, log_text, logged, steps_1580

GRAM_FORCE_N = STANDARD_GRAVITY_M_S2 / 1000.0


def test_units_become_ours_and_quotients_are_left_out():
    columns = steps_1580()
    read = imported(log_text(columns))
    recording = read.recording
    assert read.format == "RCbenchmark Series 1580/1585"
    np.testing.assert_allclose(
        recording.column("thrust_N"), columns["Thrust (gf)"] * GRAM_FORCE_N, rtol=1e-15
    )
    assert recording.column("rpm1") == pytest.approx(columns["Motor Electrical Speed (RPM)"])
    assert "Overall Efficiency" not in " ".join(recording.names)
    assert [item.kind for item in read.findings if item.kind == "doubt"] == []
    assert len(found(read, "dead channel")) == 1  # the optical probe


@pytest.mark.parametrize(
    ("row", "late_s", "read_s", "what", "line"),
    [
        (0, 0.6, [0.5, 0.5, 1.0], "time goes backwards", "2"),
        (9, 5e6, [4.5], "stray time", "11"),  # set between its neighbours
    ],
)
def test_a_row_that_is_stamped_late(row, late_s, read_s, what, line):
    time_s = steps_1580()["Time (s)"].copy()
    time_s[row] = late_s
    read = logged({"Time (s)": time_s})
    assert read.recording.column("time_s")[row : row + len(read_s)].tolist() == read_s
    assert [finding.lines for finding in found(read, what)] == [line]


def test_time_that_starts_anew_follows_on():
    time_s = np.concatenate([np.arange(12) * 0.5, np.arange(8) * 0.5])
    read = logged({"Time (s)": time_s})
    np.testing.assert_allclose(read.recording.column("time_s"), np.arange(20) * 0.5)
    (finding,) = found(read, "time starts anew")
    assert finding.lines == "14"
    assert finding.count == 8


def test_small_disorder_is_sorted():
    time_s = steps_1580()["Time (s)"].copy()
    time_s[[7, 8]] = time_s[[8, 7]]
    read = logged({"Time (s)": time_s})
    assert np.all(np.diff(read.recording.column("time_s")) > 0.0)
    assert found(read, "time goes backwards")[0].count == 1
    pulses = steps_1580()["ESC signal (µs)"].copy()
    pulses[[7, 8]] = pulses[[8, 7]]
    np.testing.assert_array_equal(read.recording.column("pwm1_us"), pulses)


@pytest.mark.parametrize("piece_bytes", [1 << 16, 1])  # one piece, one a row
def test_rows_of_other_lengths_and_of_text(piece_bytes, monkeypatch):
    monkeypatch.setattr(column_mapping, "_PIECE_BYTES", piece_bytes)
    lines = log_text(steps_1580()).splitlines()
    lines[3] = ",".join(lines[3].split(",")[:13])  # shorter
    lines.insert(5, HEADER_1580)  # another log was pasted in
    lines.insert(8, "TargetRPM,set,to,3500")  # another script's row
    lines.insert(9, "")
    lines.insert(11, ",,,,,,,,,,,,,,,,,,,,,")
    read = imported("\n".join(lines) + "\n")
    assert (read.tally.total, read.tally.kept, read.tally.refused) == (22, 20, 2)
    assert found(read, "text rows")[0].lines == "6, 9"
    assert {item.lines for item in found(read, "ragged rows")} == {"4, 9"}
    assert found(read, "empty rows")[0].count == 1


def test_an_untared_cell_and_a_pusher():
    thrust = steps_1580()["Thrust (gf)"]
    read = logged({"Thrust (gf)": thrust - 40.0})
    assert "-0.3923 N" in found(read, "untared")[0].words
    tared = logged({"Thrust (gf)": thrust - 40.0}, tare=("thrust_N",))
    np.testing.assert_allclose(
        tared.recording.column("thrust_N"), thrust * GRAM_FORCE_N, atol=1e-12
    )
    assert [item.kind for item in found(tared, "untared")] == ["repaired"]
    torque = -steps_1580()["Torque (N·m)"]
    doubts = found(logged({"Thrust (gf)": -thrust, "Torque (N·m)": torque}), "wrong sign")
    assert [item.channel for item in doubts] == ["thrust_N", "torque_Nm"]
    turned = logged({"Thrust (gf)": -thrust}, flip=("thrust_N",))
    np.testing.assert_allclose(turned.recording.column("thrust_N"), thrust * GRAM_FORCE_N)
    assert [item.kind for item in found(turned, "wrong sign")] == ["repaired"]


def test_an_rpm_spike_is_blanked():
    rpm = np.full(40, 4000.0) + np.arange(40)
    rpm[17] = 59504.0
    read = logged({"Motor Electrical Speed (RPM)": rpm}, 40)
    assert np.flatnonzero(np.isnan(read.recording.column("rpm1"))).tolist() == [17]
    (finding,) = found(read, "spikes")
    assert (finding.lines, finding.kind) == ("19", "repaired")


def test_a_step_up_and_down_of_the_throttle_is_no_spike():
    pulse = np.full(40, 1300.0)
    pulse[17] = 1900.0
    rpm = 12.0 * (pulse - 1000.0)
    columns = {"Motor Electrical Speed (RPM)": rpm, "ESC signal (µs)": pulse}
    assert found(logged(columns, 40), "spikes") == []


def test_a_wrong_pole_count():
    rpm = steps_1580()["Motor Electrical Speed (RPM)"]
    columns = {"Motor Electrical Speed (RPM)": 6.0 * rpm, "Motor Optical Speed (RPM)": rpm}
    assert "--scale rpm1=1/6" in found(logged(columns), "rpm ratio")[0].words
    mended = logged(columns, scale=("rpm1=1/6",))
    assert found(mended, "rpm ratio") == []
    assert found(mended, "scale")[0].kind == "repaired"
    strong = 1e-4 + 2e-6 * rpm
    current = strong * rpm * 2.0 * np.pi / 60.0 / (11.1 - 1e-5 * rpm) / 0.8
    hot = {"Motor Electrical Speed (RPM)": 6.0 * rpm, "Torque (N·m)": strong}
    assert "480%" in found(logged(hot | {"Current (A)": current}), "impossible efficiency")[0].words
    mended = logged({"Motor Electrical Speed (RPM)": 6.0 * rpm}, scale=("rpm1=1/6",))
    np.testing.assert_allclose(mended.recording.column("rpm1"), rpm)


def test_what_is_known_must_make_sense():
    with pytest.raises(InputError, match="CHANNEL=FACTOR"):
        imported(log_text(steps_1580()), scale=("rpm1",))
    with pytest.raises(InputError, match="known: "):
        imported(log_text(steps_1580()), flip=("lift_N",))
    constant = {"Motor Electrical Speed (RPM)": np.full(20, 5000.0)}
    constant["ESC signal (µs)"] = np.full(20, 1500.0)
    with pytest.raises(InputError, match="no row at rest"):
        logged(constant, tare=("thrust_N",))
