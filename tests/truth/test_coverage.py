"""How often the intervals of k, R and K_b hold the truth, counted over simulated sweeps.

`make coverage-truth` runs the whole count (400 sweeps, minutes); a sample of it runs every time.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import numpy as np
import pytest
from scipy.stats import binom

from benchtool.fit.recipe import Method
from tests.truth.sweep_trial import COUNTED, Trial, run_trial

SCORED = range(2000, 2400)
"""Seeds that are counted; nothing was ever chosen by looking at them."""

SAMPLE = range(1000, 1008)
BOTH: tuple[Method, ...] = ("least_squares", "emcee")


def counts(trials: Sequence[Trial], method: Method) -> dict[str, tuple[int, int]]:
    """Return how often the 68 % and the 95 % interval held the truth, by parameter."""
    return {
        name: (
            sum(trial.held[method][name][0] for trial in trials),
            sum(trial.held[method][name][1] for trial in trials),
        )
        for name in COUNTED
    }


def test_a_sample_of_sweeps_holds_the_truth() -> None:
    """Eight sweeps: a count that a right interval gives with a chance above 1 in 1000."""
    trials = [run_trial(seed, ("least_squares",)) for seed in SAMPLE]
    for name, (at_68, at_95) in counts(trials, "least_squares").items():
        least_68, least_95 = (int(binom.ppf(1e-3, len(trials), p)) for p in (0.68, 0.95))
        assert at_68 >= least_68, (name, at_68)
        assert at_95 >= least_95, (name, at_95)
    far = max(abs(z) for trial in trials for z in trial.z["least_squares"].values())
    assert far < 4.0


@pytest.mark.soak
def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        trials = list(pool.map(partial(run_trial, methods=BOTH), SCORED, chunksize=4))
    n = len(trials)
    print(f"\n{n} simulated sweeps; intervals that hold the truth, of k, R and K_b")
    print(f"{'method':<14} {'parameter':<14} {'68 %':>8} {'95 %':>8} {'rms z':>8}")
    wrong = []
    for method in BOTH:
        for name, (at_68, at_95) in counts(trials, method).items():
            rms = float(np.sqrt(np.mean([trial.z[method][name] ** 2 for trial in trials])))
            print(f"{method:<14} {name:<14} {at_68 / n:>8.1%} {at_95 / n:>8.1%} {rms:>8.2f}")
            if not (0.60 <= at_68 / n <= 0.76 and 0.92 <= at_95 / n <= 0.98):
                wrong.append((method, name, at_68, at_95))
    assert not wrong
