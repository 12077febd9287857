"""Runs through load cells whose few masses know their slopes far worse than the runs know k."""

from __future__ import annotations

import json
import shutil
from dataclasses import asdict
from pathlib import Path

import numpy as np

from benchtool.acquire.calibration import fit_calibration

ROOT = Path(__file__).parents[3]
TRUTH = 1.02e-5  # k that the bench of `datasets/quad` was made with

MASSES_KG = np.array([0.0, 0.2, 0.5, 1.0, 1.5])
COUNTS_PER_N = 420.0
SD_COUNTS = 20.0
"""Scatter of a reading: the slope is then known to 0.4 %, far worse than what a run says of k."""


def weighed(seed: int, folder: Path, cells: int) -> dict[str, float]:
    """Hang five masses on each cell and write a run whose thrusts went through it."""
    rng = np.random.default_rng([22, seed, cells])
    for cell in range(cells):
        counts = 8000.0 + COUNTS_PER_N * 9.80665 * MASSES_KG + rng.normal(0.0, SD_COUNTS, 5)
        known = fit_calibration(MASSES_KG, counts, date="2026-01-31", device_id=f"cell-{cell}")
        run = folder / f"run{cell}"
        shutil.copytree(ROOT / "datasets/quad/run", run, ignore=shutil.ignore_patterns("samples*"))
        _scale_thrust(run, COUNTS_PER_N * known.slope_N_per_count)
        facts = json.loads((run / "metadata.json").read_text("utf-8"))
        facts |= {"calibration": asdict(known), "operator": f"trial {cell}"}
        (run / "metadata.json").write_text(json.dumps(facts), "utf-8")
    return {"k": TRUTH}


def _scale_thrust(run: Path, factor: float) -> None:
    """Write a run's thrusts as a cell with another slope shows them."""
    header, *rows = (run / "points.csv").read_text("utf-8").splitlines()
    names = header.split(",")
    places = [at for at, name in enumerate(names) if name.startswith(("thrust_N", "thrust_se_N"))]
    out = [header]
    for row in rows:
        cells = row.split(",")
        for place in places:
            cells[place] = repr(float(cells[place]) * factor)
        out.append(",".join(cells))
    (run / "points.csv").write_text("\n".join(out) + "\n", "utf-8")
