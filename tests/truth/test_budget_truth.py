"""How often budgets hold the truth, by propagation and by Monte Carlo, over simulated benches."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from scipy.stats import binom, binomtest

from benchtool.fit.run_recipe import propagated, run_recipe
from benchtool.fit.uncertainty.monte_carlo import monte_carlo
from tests.truth.budgets import COUNTED, budget_bench, budget_recipe

SIXTY = range(6000, 6060)
"""Seeds of the benches that both ways are held against."""

SCORED = range(7000, 7400)
"""Seeds that are counted; nothing was ever chosen by looking at them."""

Trial = dict[str, tuple[float, float, bool, bool]]
"""By quantity: error over combined, over fit's own, whether each interval holds the truth."""


def trial(seed: int, draws: int) -> Trial:
    """Fit one bench; intervals by propagation, then by so many draws where there are any."""
    with TemporaryDirectory() as folder:
        table = Path(folder) / "bench.csv"
        truth = budget_bench(seed, table)
        output = run_recipe(budget_recipe(table))
    budget, found = output.budget, propagated(output)
    assert budget is not None
    assert found is not None
    checked = monte_carlo(*found, draws=draws, seed=seed) if draws else None
    held: Trial = {}
    for name in COUNTED:
        place = budget.names.index(name)
        error = budget.values[place] - truth[name]
        low, high = -budget.expanded[place], budget.expanded[place]
        within = checked is None or checked.low[place] <= error <= checked.high[place]
        held[name] = (
            error / budget.combined[place],
            error / budget.fit_sd[place],
            bool(low <= error <= high),
            within,
        )
    return held


def trials(seeds: Sequence[int], draws: int) -> list[Trial]:
    with ProcessPoolExecutor(min(os.cpu_count() or 1, 4)) as pool:
        return list(pool.map(partial(trial, draws=draws), seeds, chunksize=4))


@pytest.mark.slow
def test_both_ways_hold_the_truth_of_sixty_benches() -> None:
    """Counts that right intervals give with a chance above 1 in 1000."""
    found = trials(SIXTY, draws=400)
    least = int(binom.ppf(1e-3, len(found), 0.95))
    for name in COUNTED:
        held = [sum(one[name][way] for one in found) for way in (2, 3)]
        print(f"{name}: propagation {held[0]}, Monte Carlo {held[1]} of {len(found)} at 95 %")
        assert min(held) >= least, (name, held)
        rms = float(np.sqrt(np.mean([one[name][0] ** 2 for one in found])))
        assert 0.75 < rms < 1.3, (name, rms)


@pytest.mark.soak
def test_expanded_intervals_hold_the_truth_as_often_as_they_say() -> None:
    found = trials(SCORED, draws=0)
    print(f"\n{len(found)} simulated benches; expanded intervals (95 %) that hold the truth")
    for name in COUNTED:
        held = sum(one[name][2] for one in found)
        within = sum(abs(one[name][0]) <= 1.0 for one in found)
        rms = [float(np.sqrt(np.mean([one[name][i] ** 2 for one in found]))) for i in (0, 1)]
        print(
            f"{name:<14} {held / len(found):.1%} rms z {rms[0]:.2f}, of the fit alone {rms[1]:.2f}"
        )
        for count, level in ((held, 0.95), (within, 0.6827)):
            limits = binomtest(count, len(found)).proportion_ci(0.999, method="wilson")
            assert limits.low <= level <= limits.high, (name, count)
