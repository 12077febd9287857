"""Batches: what a run gives depends on its seed and number alone."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.simulate.noise import lane_states, next_state, normal
from benchtool.simulate.pitch.lane import cosine, sine
from benchtool.simulate.pitch.run import PitchLoop
from benchtool.simulate.pitch.simulate import LANES, extract_run, simulate_many, simulate_pitch
from tests.unit.simulate.pitching import STEADY_PLATE, SWAY, job, noisy_bench, sampled, soft

SCHEDULE = sampled(0.5, reference_deg=SWAY, plate=STEADY_PLATE)


def whole_log(loop: PitchLoop, lane: int, run: int) -> tuple[int, np.ndarray]:
    return run, loop.log[:, :, lane].copy()


@pytest.mark.parametrize("threads", [1, 2])
def test_a_run_is_the_same_alone_and_in_any_batch(threads):
    each = job(noisy_bench("pitch_beam"), soft("observer"))
    runs = [(each, run) for run in range(LANES + 5)]
    many = dict(simulate_many(runs, SCHEDULE, whole_log, seed=9, threads=threads))
    assert list(many) == list(range(LANES + 5))
    for run in (0, 3, LANES - 1, LANES, LANES + 4):
        alone = simulate_pitch(each, SCHEDULE, seed=9, run=run)
        np.testing.assert_allclose(many[run], alone.log, rtol=1e-12, atol=1e-13)
    assert not np.array_equal(many[0], many[1])


def test_a_lane_that_leaves_the_finite_numbers_is_reported():
    loop = PitchLoop([job(noisy_bench(), soft())], SCHEDULE, 0, [0])
    loop.run()
    loop.log[100, 3, 0] = np.nan
    with pytest.raises(Exception, match=r"is not finite from 0\.2 s"):
        extract_run(loop, 0, "pid")


def test_normal_numbers_are_normal():
    states = lane_states(3, range(2000))
    numbers = []
    for _ in range(500):
        states = next_state(states)
        first = states
        states = next_state(states)
        numbers.append(normal(first, states))
    values = np.concatenate(numbers)
    assert values.mean() == pytest.approx(0.0, abs=4e-3)
    assert values.std() == pytest.approx(1.0, abs=3e-3)
    assert np.mean(values**4) == pytest.approx(3.0, abs=0.04)
    for level, share in ((1.0, 0.15866), (2.0, 0.02275), (3.0, 0.00135)):
        for tail in (values > level, values < -level):
            assert tail.mean() == pytest.approx(share, abs=4.0 * np.sqrt(share / values.size))
    table = np.array(numbers)
    assert abs(np.mean(table[1:] * table[:-1])) < 4e-3
    assert abs(np.mean(table[:, 1:] * table[:, :-1])) < 4e-3


def test_polynomials_are_sine_and_cosine_up_to_a_quarter_turn():
    angles = np.linspace(-np.pi / 2.0, np.pi / 2.0, 2001)
    np.testing.assert_allclose(sine(angles), np.sin(angles), atol=1e-15)
    np.testing.assert_allclose(cosine(angles), np.cos(angles), atol=1e-15)
