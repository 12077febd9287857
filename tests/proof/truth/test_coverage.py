"""How often intervals hold the truth, over simulated sweeps: a sample, and the judge of counts.

`make coverage-truth` runs the whole count (400 sweeps of each kind, hours).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtri
from scipy.stats import binom

from benchtool.data.run.read import read_points
from benchtool.fit.recipe import Method
from benchtool.tasks import TaskStore, run_tasks
from tests.proof.truth.benches import drawn, visited
from tests.proof.truth.cells import (
    CELLS,
    Sweep,
    off_grid_sweep,
    quad_chain,
    quad_sweep,
    single_sweep,
    two_calibrations,
    wandering_sweep,
)
from tests.proof.truth.count import (
    LEVELS,
    Held,
    Trial,
    cells_of,
    counted,
    faults,
    run_trial,
    table,
    trial_of,
)

SAMPLE = range(1000, 1006)


@pytest.mark.parametrize(
    "sweep",
    [
        quad_sweep,
        single_sweep,
        pytest.param(off_grid_sweep, marks=pytest.mark.proof),
        pytest.param(wandering_sweep, marks=pytest.mark.proof),
        pytest.param(two_calibrations, marks=pytest.mark.proof),
    ],
)
def test_a_sample_of_sweeps_holds_the_truth(sweep):
    """Counts that right intervals give with a chance above 1 in 1000, in every cell."""
    trials = [run_trial(sweep, "least_squares", seed) for seed in SAMPLE]
    counts = counted(trials, "least_squares")
    assert {one.cell for one in counts} == {cell.name for cell in CELLS if cell.sweep is sweep}
    for one in counts:
        assert one.trials == len(SAMPLE)
        for held, level in zip(one.held, LEVELS, strict=True):
            assert held >= int(binom.ppf(1e-3, len(SAMPLE), level)), one
        assert one.rms_z < 2.5


def test_the_whole_tool_measures_what_the_plant_alone_does():
    trial = run_trial(quad_chain, "least_squares", SAMPLE[0])
    for found in trial["quad, benchtool sweep and fit"].values():
        assert abs(found.value - found.truth) < 4.0 * found.sd


def test_points_hold_the_errors_of_voltage_and_current(tmp_path):
    bench = drawn(SAMPLE[0], "single_bench")
    visited(bench, tmp_path / "run")
    points = read_points(tmp_path / "run")
    for name, error in (("voltage_V", "voltage_se_V"), ("current_A", "current_se_A")):
        sensor = bench.rig.sensors[name]
        # The mean of one second at the sensor's own rate.
        expected = sensor.mean_error(np.array([sensor.rate_Hz]))
        assert np.median(points.column(error)) == pytest.approx(expected, rel=0.5)


def trials_with(spread: float, n: int = 400, seed: int = 1) -> list[Trial]:
    """Return trials whose intervals are so many times as wide as the scatter of their values."""
    rng = np.random.default_rng(seed)
    wide = [float(ndtri(0.5 + 0.5 * level)) for level in LEVELS]
    return [
        {
            "cell": {
                name: Held(
                    truth=10.0,
                    value=value,
                    sd=spread,
                    interval_68=(value - wide[0] * spread, value + wide[0] * spread),
                    interval_95=(value - wide[1] * spread, value + wide[1] * spread),
                )
                for name, value in zip("abcde", 10.0 + rng.standard_normal(5), strict=True)
            }
        }
        for _ in range(n)
    ]


def test_right_intervals_pass_and_inflated_or_narrow_ones_do_not():
    right, wide, narrow = (counted(trials_with(s), "least_squares") for s in (1.0, 1.25, 0.8))
    assert faults(right) == []
    assert any("intervals of 68% hold" in fault for fault in faults(wide))
    assert any("rms z is 0.8" in fault for fault in faults(wide))
    assert any("intervals of 95% hold" in fault for fault in faults(narrow))
    assert right[0].width == pytest.approx(1.0, abs=0.08)
    assert "| cell | least_squares | a | 400 |" in table(right)


def test_a_mean_off_by_a_third_of_what_is_stated_is_a_bias():
    trials = [
        {"cell": {name: replace(fit, truth=fit.truth - 0.33) for name, fit in cell.items()}}
        for cell in (trial["cell"] for trial in trials_with(1.0))
    ]
    counts = counted(trials, "least_squares")
    assert all(count.is_biased for count in counts)
    assert any("mean z is +0.3" in fault for fault in faults(counts))
    assert not any(replace(count, mean_z=0.1).is_biased for count in counts)


def test_a_trial_is_stored_whole(tmp_path):
    item: tuple[Sweep, Method, int] = (single_sweep, "least_squares", 1000)
    with TaskStore(tmp_path / "trials.jsonl", {}) as store:
        ((_, fresh),) = run_tasks(cells_of, {"1000": item}, store=store, processes=0)
        assert trial_of(store["1000"]) == trial_of(fresh) == run_trial(*item)
