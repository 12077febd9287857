"""How often fits through a load cell of five masses hold the thrust coefficient.

Each trial hangs five masses on a cell that scatters, takes the calibration into runs whose thrusts
went through it, and fits them; with two runs each cell has a calibration of its own.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binom, binomtest, t

from benchtool.acquire.calibration import fit_calibration
from benchtool.core.fit_result import Estimate
from benchtool.fit.recipe import Method, read_recipe
from benchtool.fit.run_recipe import run_recipe

ROOT = Path(__file__).parents[2]
TRUTH = 1.02e-5
"""k that the bench of `datasets/quad` was made with."""

MASSES_KG = np.array([0.0, 0.2, 0.5, 1.0, 1.5])
COUNTS_PER_N = 420.0
SD_COUNTS = 20.0
"""Scatter of a reading: the slope is then known to 0.4 %, far worse than what a run says of k."""

SCORED = range(5000, 5400)
SAMPLE = range(4000, 4008)
CELLS = {"one cell of five masses": 1, "two cells of five masses": 2}


def weighed(seed: int, cells: int, folder: Path, methods: Sequence[Method]) -> list[Estimate]:
    """Return what the fits of runs through so many cells say of k."""
    rng = np.random.default_rng([22, seed, cells])
    runs = []
    for cell in range(cells):
        counts = 8000.0 + COUNTS_PER_N * 9.80665 * MASSES_KG + rng.normal(0.0, SD_COUNTS, 5)
        known = fit_calibration(MASSES_KG, counts, date="2026-01-31", device_id=f"cell-{cell}")
        run = folder / f"run{cell}-{seed}"
        shutil.copytree(ROOT / "datasets/quad/run", run)
        scale_thrust(run, COUNTS_PER_N * known.slope_N_per_count)
        facts = json.loads((run / "metadata.json").read_text("utf-8"))
        facts |= {"calibration": asdict(known), "operator": f"trial {cell}"}
        (run / "metadata.json").write_text(json.dumps(facts), "utf-8")
        runs.append(str(run))
    recipe = replace(
        read_recipe(ROOT / "fits/quad"), data=tuple(runs), methods=tuple(methods), compare=()
    )
    return [result["k"] for result in run_recipe(recipe).results]


def scale_thrust(run: Path, factor: float) -> None:
    """Write a run's thrusts as a cell with another slope shows them."""
    header, *rows = (run / "points.csv").read_text("utf-8").splitlines()
    places = [place for place, name in enumerate(header.split(",")) if name.startswith("thrust_N")]
    places += [place for place, name in enumerate(header.split(",")) if name == "thrust_se_N"]
    out = [header]
    for row in rows:
        cells = row.split(",")
        for place in places:
            cells[place] = repr(float(cells[place]) * factor)
        out.append(",".join(cells))
    (run / "points.csv").write_text("\n".join(out) + "\n", "utf-8")


def holds(found: Sequence[Estimate]) -> tuple[int, int]:
    """Return how many of the 68 % and of the 95 % intervals hold the truth."""
    at_68 = sum(k.interval_68[0] <= TRUTH <= k.interval_68[1] for k in found)
    return at_68, sum(k.interval_95[0] <= TRUTH <= k.interval_95[1] for k in found)


@pytest.mark.parametrize("cells", CELLS.values(), ids=CELLS)
def test_a_sample_of_calibrations_holds_the_truth(cells: int, tmp_path: Path) -> None:
    """Eight: a count that a right interval gives with a chance above 1 in 1000."""
    found = [weighed(seed, cells, tmp_path, ("least_squares",))[0] for seed in SAMPLE]
    for held, p in zip(holds(found), (0.6827, 0.95), strict=True):
        assert held >= int(binom.ppf(1e-3, len(SAMPLE), p))


@pytest.mark.soak
@pytest.mark.parametrize("name", CELLS)
def test_calibrated_fits_hold_the_truth_as_often_as_they_say(name: str, tmp_path: Path) -> None:
    found = [weighed(seed, CELLS[name], tmp_path, ("least_squares",))[0] for seed in SCORED]
    held, n = holds(found), len(found)
    rms = np.sqrt(np.mean([(k.value - TRUTH) ** 2 for k in found]))
    half = [0.5 * (k.interval_68[1] - k.interval_68[0]) for k in found]
    print(
        f"\n{name}: {n} fits, k held in {held[0] / n:.1%} of 68 %, {held[1] / n:.1%} of 95 %; "
        f"median half width of 68 % over rms error {np.median(half) / rms:.2f}"
    )
    for count, p in zip(held, (0.6827, 0.95), strict=True):
        low, high = binomtest(count, n).proportion_ci(0.999, method="wilson")
        assert low <= p <= high, (name, p, count)
    # Not bought by width: Student's t of the cells' own degrees of freedom, and room for counting.
    assert np.median(half) / rms < 1.15 * t.ppf(0.84, 3.0)
