"""A run ends before motors turn where the plate is not seen to stand where it was sent."""

from __future__ import annotations

import pytest

from tests.faults.loop import plan, sweep
from tests.faults.proxy import Fault

NEAR = plan("0.06, 0.12")


def test_a_sensor_30_mm_off(tmp_path):
    off = Fault("lie", phase="connect", way="host", channel="plate_z_m", value=-0.03)
    outcome = sweep(tmp_path, plan("1.36"), [off])
    assert off.hit > 0
    assert (outcome.code, outcome.points()) == (3, []), outcome.said
    assert max((us for _, us in outcome.pulses), default=1000.0) == 1000.0
    assert "plate_z_m reads 1.33" in outcome.last_line


def test_a_sensor_that_freezes_in_mid_run_ends_it_at_the_next_move(tmp_path):
    frozen = Fault("freeze", phase="sampling", way="host", channel="plate_z_m")
    outcome = sweep(tmp_path, NEAR, [frozen])
    assert frozen.hit > 0
    assert outcome.code == 3
    assert [float(point["plate_read_z_m"]) for point in outcome.points()] == [pytest.approx(0.06)]
    assert "still reads 0.0600 m after the move to 0.122" in outcome.last_line


def test_a_plate_that_creeps_inside_the_gap_while_motors_turn(tmp_path):
    near = Fault("lie", after_s=0.5, way="host", channel="plate_z_m", value=-0.03)
    outcome = sweep(tmp_path, plan("0.06", sample_s=10.0), [near])
    assert near.hit > 0
    assert near.begun_s is not None
    assert outcome.code == 4
    assert "plate_z_m read 0.03, limit 0.05" in outcome.last_line
    # Zero reaches the motor within a tenth of a second of the first such sample.
    assert outcome.pulse_at(near.begun_s + 0.1) == 1000.0


def test_both_numbers_stand_in_each_point_and_the_stage_in_metadata(tmp_path):
    outcome = sweep(tmp_path, plan("1.36"), [])
    point = outcome.points()[0]
    assert float(point["plate_stage_z_m"]) == pytest.approx(1.36)
    assert float(point["plate_read_z_m"]) == pytest.approx(1.36)
    assert outcome.metadata["plate"] == {
        "stage": "device",
        "measured": True,
        "tolerance_m": pytest.approx(0.0015),
        "used": True,
    }
