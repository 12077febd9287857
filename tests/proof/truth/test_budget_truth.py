"""How often budgets hold the truth of sixty simulated benches, by propagation and Monte Carlo."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom

from benchtool.fit.run_recipe import propagate_uncertainty, run_recipe
from benchtool.fit.uncertainty.propagation import monte_carlo
from tests.proof.truth.cells import CELLS

SIXTY = range(6000, 6060)  # seeds of the benches; nothing was ever chosen by looking at them


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_both_ways_hold_the_truth_of_sixty_benches(tmp_path):
    """Counts that right intervals give with a chance above 1 in 1000, and an rms z of about 1."""
    (cell,) = (cell for cell in CELLS if cell.budget)
    z: dict[str, list[float]] = {name: [] for name in cell.counted}
    held = {name: [0, 0] for name in cell.counted}
    for seed in SIXTY:
        truth = cell.sweep(seed, tmp_path / "run")
        output = run_recipe(cell.recipe(tmp_path / "run", ("least_squares",), seed))
        budget, found = output.budget, propagate_uncertainty(output)
        assert budget is not None
        assert found is not None
        checked = monte_carlo(found, draws=200, seed=seed)
        for name in cell.counted:
            place = budget.names.index(name)
            error = budget.values[place] - truth[name]
            z[name].append(error / budget.combined[place])
            held[name][0] += abs(error) <= budget.expanded[place]
            held[name][1] += checked.low[place] <= error <= checked.high[place]
    least = int(binom.ppf(1e-3, len(SIXTY), 0.95))
    for name, counts in held.items():
        print(f"{name}: propagation {counts[0]}, Monte Carlo {counts[1]} of {len(SIXTY)} at 95 %")
        assert min(counts) >= least, (name, counts)
        assert 0.75 < float(np.sqrt(np.mean(np.square(z[name])))) < 1.3, name
