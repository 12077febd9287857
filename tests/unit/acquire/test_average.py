from __future__ import annotations

import numpy as np
import pytest

from benchtool.acquire.average import (
    average,
    fit_slope,
    is_settled,
)
from benchtool.core.rig import Sensor


def autoregressive(rng: np.random.Generator, shape: tuple[int, int], rho: float) -> np.ndarray:
    noise = rng.normal(size=shape)
    values = np.empty(shape)
    values[:, 0] = noise[:, 0] / np.sqrt(1.0 - rho**2)
    for i in range(1, shape[1]):
        values[:, i] = rho * values[:, i - 1] + noise[:, i]
    return values


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.8])
def test_the_standard_error_is_the_scatter_of_means(rho):
    values = autoregressive(np.random.default_rng(5), (400, 500), rho)
    scatter = values.mean(axis=1).std(ddof=1)
    stated = np.sqrt(np.mean([average(row).se ** 2 for row in values]))
    assert stated == pytest.approx(scatter, rel=0.12)


@pytest.mark.parametrize("rho", [0.0, 0.6])
@pytest.mark.parametrize("lines", [1, 4])
def test_vibrations_do_not_count_as_errors_of_the_mean(lines, rho):
    rng = np.random.default_rng(12)
    values = autoregressive(rng, (400, 160), rho)
    time_s = np.arange(160) / 80.0
    for _ in range(lines):
        frequency_Hz, phase = 10.5 + rng.uniform(-0.5, 0.5, 400), rng.uniform(0.0, 2 * np.pi, 400)
        turns = 2 * np.pi * frequency_Hz[:, None] * time_s
        values += 1.1 / np.sqrt(lines) * 2.0 * np.cos(turns + phase[:, None])
    scatter = values.mean(axis=1).std(ddof=1)
    found = [average(row) for row in values]
    assert np.sqrt(np.mean([one.se**2 for one in found])) == pytest.approx(scatter, rel=0.2)
    assert np.mean([one.sd for one in found]) > 1.5


def test_gaps_are_left_out_and_few_values_are_told():
    found = average(np.array([1.0, np.nan, 3.0]))
    assert (found.mean, found.n) == (2.0, 2)
    assert average(np.array([np.nan])).n == 0
    assert np.isnan(average(np.array([4.0])).se)


def test_a_silent_channel_has_the_error_of_rounding():
    assert average(np.full(100, 2.0), quantum=0.12).se == pytest.approx(0.12 / np.sqrt(12.0))


@pytest.mark.parametrize("noise", [0.0, 0.1, 0.3, 0.5, 0.7, 1.0])
def test_rounding_counts_as_far_as_noise_leaves_it(noise):
    """Errors of means scatter by their standard error; within a quarter where steps are many."""
    rng = np.random.default_rng(8)
    true = rng.uniform(0.0, 1.0, 400)
    samples = np.round(true[:, None] + noise * rng.standard_normal((400, 50)))
    averages = [average(row, quantum=1.0) for row in samples]
    z = [(one.mean - at) / one.se for one, at in zip(averages, true, strict=True)]
    assert 0.7 < np.sqrt(np.mean(np.square(z))) < 1.25
    stated = Sensor(noise=noise, quantum=1.0).mean_error(np.array([50.0]))
    assert stated == pytest.approx(np.std(samples.mean(axis=1) - true), rel=0.25)


def test_settled_needs_a_whole_window_and_every_channel():
    time_s = np.arange(150) / 100.0
    flat = np.full(150, 5.0)
    falling = 5.0 - 0.1 * time_s
    assert is_settled(time_s, [flat], 1.0, 0.002)
    assert not is_settled(time_s[:50], [flat[:50]], 1.0, 0.002)
    assert not is_settled(time_s, [flat, falling], 1.0, 0.002)
    assert not is_settled(np.empty(0), [np.empty(0)], 1.0, 0.002)
    assert not is_settled(time_s, [np.full(150, np.nan)], 1.0, 0.002)
    assert not is_settled(time_s, [], 1.0, 0.002)


@pytest.mark.parametrize("rho", [0.0, 0.8])
@pytest.mark.parametrize("share", [0.0, 0.01, 0.04])
def test_missed_counts_move_neither_mean_nor_standard_error(rho, share):
    """2,000 simulated visits of 200 speeds about 4312 rpm, some of them read at half speed."""
    rng = np.random.default_rng(17)
    clean = 4312.0 + 12.0 * autoregressive(rng, (2000, 200), rho)
    missed = rng.random(clean.shape) < share
    found = [average(row, quantum=1.0) for row in np.where(missed, 0.5 * clean, clean)]
    used = np.array([not item.suspect for item in found])
    assert used.mean() > 0.7
    more = [item.n_rejected for item in found] - np.where(used, missed.sum(axis=1), 0)
    assert (more >= 0).all()
    assert more.sum() < 1e-4 * clean.size  # clean samples that were rejected
    error = (np.array([item.mean for item in found]) - 4312.0)[used]
    assert abs(error.mean()) < 4.0 * error.std() / np.sqrt(len(error))
    whole = clean[used].mean(axis=1) - 4312.0
    assert error.std() == pytest.approx(whole.std() / np.sqrt(1.0 - share), rel=0.05)
    stated = np.sqrt(np.mean([item.se**2 for item in found if not item.suspect]))
    assert stated == pytest.approx(error.std(), rel=0.12)  # as without outliers


@pytest.mark.parametrize("share", [0.06, 0.3, 0.48])
def test_a_rotor_that_hunts_is_not_halved(share):
    rng = np.random.default_rng(9)
    slow = rng.permutation(400) < share * 400
    readings = np.where(slow, 4000.0, 4400.0) + 8.0 * rng.normal(size=400)
    found = average(readings, quantum=1.0)
    assert (found.n, found.n_rejected) == (400, 0)
    assert found.mean == pytest.approx(readings.mean())
    assert found.suspect
    assert "none is excluded" in found.rejection("rpm1")


@pytest.mark.parametrize(
    ("values", "quantum", "rejected"),
    [
        ([4000.0] * 99 + [2000.0], 0.0, 1),
        ([4000.0] * 97 + [4001.0] * 3, 0.0, 0),  # the step of its resolution
        ([4000.0] * 97 + [4001.0] * 2 + [2000.0], 0.0, 1),
        ([0.0] * 98 + [0.12] * 2, 0.12, 0),
        ([4000.0] * 6 + [2000.0], 0.0, 0),  # too few to judge
    ],
)
def test_steps_of_a_coarse_sensor_are_no_outliers(values, quantum, rejected):
    assert average(np.array(values), quantum).n_rejected == rejected


def test_slope_and_error_of_a_noisy_line():
    rng = np.random.default_rng(7)
    time_s = np.arange(400) / 100.0
    found = fit_slope(time_s, 3.0 + 0.5 * time_s + 0.1 * rng.normal(size=400))
    assert found.per_s == pytest.approx(0.5, abs=4.0 * found.se_per_s)
    expected = 0.1 / np.sqrt(((time_s - time_s.mean()) ** 2).sum())
    assert found.se_per_s == pytest.approx(expected, rel=0.25)
    assert not found.is_settled(0.01)
    assert found.is_settled(0.2)
