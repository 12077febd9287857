"""A rotor's vibration at a multiple of the sampling rate reads as thrust: the point says so."""

from __future__ import annotations

import numpy as np
import pytest

import benchtool as bt
from benchtool.acquire.measure import is_aliased
from benchtool.data.run.read import read_points

RATE_HZ, COUNT = 200.0, 200
TIMES_S = np.arange(COUNT) / RATE_HZ

RIG = """name = "loud"
[propulsion]
source = "made for a test"
radius_m = 0.0635
pwm_stop_us = 1000.0
pwm_start_us = 1050.0
pwm_max_us = 1950.0
speed_per_us_rad_s = 2.0
thrust_coefficient_N_s2 = 1e-6
[limits]
source = "made for a test"
load_cell_rating_N = 20.0
thrust_N = 15.0
"""


def test_every_frequency_that_moves_a_mean_is_named():
    random = np.random.default_rng(3)
    named = 0
    for turns_Hz in random.uniform(20.0, 420.0, 4000):
        phase = random.uniform(0.0, 2.0 * np.pi)
        mean = np.sin(2.0 * np.pi * turns_Hz * TIMES_S + phase).mean()
        if is_aliased(60.0 * turns_Hz, TIMES_S):
            named += 1
        elif turns_Hz > 0.5 * RATE_HZ:
            assert abs(mean) < 0.25, turns_Hz
    # A band of 2 Hz about 200 and about 400 Hz, in 400 Hz.
    assert 25 <= named <= 60


def test_a_point_of_a_sweep_is_marked_and_left_out_of_motor_constants(tmp_path):
    rig = tmp_path / "loud.toml"
    rig.write_text(RIG)
    run = bt.sweep(f"sim:{rig}", plan="steps", yes=True, out=tmp_path / "run")
    points = read_points(tmp_path / "run")
    marked = points.column("suspect") == 1.0
    assert set(points.column("pwm1_us")[marked]) == {1680.0}  # 12,000 rpm at 200 samples a second
    off_N = points.column("thrust_N") - 1e-6 * (points.column("rpm1") * np.pi / 30.0) ** 2
    assert np.abs(off_N[marked]).max() > 5.0 * np.nanmax(np.abs(off_N[~marked]))
    found = bt.motor(run).found
    assert found.value("k") == pytest.approx(1e-6, rel=5e-4)
    assert 1680.0 not in found.points.pulse_us
