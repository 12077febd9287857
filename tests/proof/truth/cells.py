"""What `make coverage-truth` counts: a cell is a simulated sweep and a recipe that fits it.

A new cell is one entry of `CELLS` (and, for errors of another kind, one function beside
`quad_sweep` that makes them). Cells of one sweep share its simulation.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from benchtool.core.choices import Method
from benchtool.fit.recipe import Recipe
from tests.proof.truth.benches import (
    Truth,
    chained,
    drawn,
    misplaced,
    off_grid,
    visited,
    wandering,
)
from tests.proof.truth.budgets import budget_sweep
from tests.proof.truth.calibrated import weighed

Sweep = Callable[[int, Path], Truth]
"""sweep(seed, path) -> the truth of a bench that was drawn with the seed and swept into a run."""


def quad_sweep(seed: int, path: Path) -> Truth:
    """Sweep a quadrotor with body lift."""
    bench = drawn(seed, "quad_bench")
    visited(bench, path)
    return bench.truth


def single_sweep(seed: int, path: Path) -> Truth:
    """Sweep a single rotor."""
    bench = drawn(seed, "single_bench")
    visited(bench, path)
    return bench.truth


def quad_chain(seed: int, path: Path) -> Truth:
    """Sweep a quadrotor by the command, which takes five times as long."""
    bench = drawn(seed, "quad_bench")
    chained(bench, path)
    return bench.truth


def single_chain(seed: int, path: Path) -> Truth:
    """Sweep a single rotor by the command."""
    bench = drawn(seed, "single_bench")
    chained(bench, path)
    return bench.truth


def misplaced_sweep(seed: int, path: Path) -> Truth:
    """Sweep a quadrotor whose plate finds a place again within 0.3 mm."""
    bench = misplaced(drawn(seed, "quad_bench"), 3e-4)
    visited(bench, path)
    return bench.truth


def off_grid_sweep(seed: int, path: Path) -> Truth:
    """Sweep a quadrotor at distances between the steps, 0.5 mm, of their reading."""
    bench = off_grid(drawn(seed, "quad_bench"), 5e-4)
    visited(bench, path)
    return bench.truth


def wandering_sweep(seed: int, path: Path) -> Truth:
    """Sweep a single rotor on a load cell whose zero walks 1 mN in a second."""
    bench = wandering(drawn(seed, "single_bench"), 1e-3)
    visited(bench, path)
    return bench.truth


def one_calibration(seed: int, path: Path) -> Truth:
    """Take a run's thrusts through a cell of five masses."""
    return weighed(seed, path, 1)


def two_calibrations(seed: int, path: Path) -> Truth:
    """Take two runs' thrusts through a cell each."""
    return weighed(seed, path, 2)


def three_calibrations(seed: int, path: Path) -> Truth:
    """Take three runs' thrusts through a cell each."""
    return weighed(seed, path, 3)


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """State what is simulated, how it is fitted, and which numbers are counted."""

    name: str
    sweep: Sweep
    model: str  # that the fit takes
    counted: tuple[str, ...]
    options: Mapping[str, Any] = field(default_factory=dict)  # of the recipe
    budget: bool = False  # whether intervals are those of the uncertainty budget

    def counts(self, method: Method) -> bool:
        """Whether the cell is counted with a method: budgets are of least squares alone."""
        return method == "least_squares" or not self.budget

    def recipe(self, run: Path, methods: tuple[Method, ...], seed: int) -> Recipe:
        """Return the fit of a run; few walkers, for the sake of time."""
        return Recipe(
            name=self.name,
            data=tuple(map(str, sorted(run.glob("run*")) or [run])),
            model=self.model,
            methods=methods,
            seed=seed,
            **{"walkers": 16, **self.options},
        )


CELLS: tuple[Cell, ...] = (
    Cell(
        name="quad, joint: budget",
        sweep=budget_sweep,
        model="quad_bench",
        counted=("k", "R_m", "body_lift.K_b"),
        options={"rig": "pquad"},
        budget=True,
    ),
    Cell(
        name="quad, joint",
        sweep=quad_sweep,
        model="quad_bench",
        counted=("k", "R_m", "body_lift.K_b"),
    ),
    *(
        Cell(
            name=f"quad, {basis}",
            sweep=quad_sweep,
            model="quad_bench",
            counted=("R_m", "body_lift.K_b"),
            options={"basis": basis},
        )
        for basis in ("equal_rpm2", "equal_pwm", "equal_power")
    ),
    Cell(
        name="quad, benchtool sweep and fit",
        sweep=quad_chain,
        model="quad_bench",
        counted=("k", "R_m", "body_lift.K_b"),
    ),
    Cell(
        name="single, benchtool sweep and fit",
        sweep=single_chain,
        model="single_bench",
        counted=("k", "R_m"),
    ),
    Cell(name="single, joint", sweep=single_sweep, model="single_bench", counted=("k", "R_m")),
    *(
        Cell(
            name=f"single, {basis}",
            sweep=single_sweep,
            model="single_bench",
            counted=("R_m",),
            options={"basis": basis},
        )
        for basis in ("equal_rpm2", "equal_pwm", "equal_power")
    ),
    *(
        Cell(
            name=f"{name}, {basis}",
            sweep=sweep,
            model=model,
            counted=("k", *counted) if basis == "joint" else counted,
            options={"basis": basis},
        )
        for name, sweep, model, counted in (
            ("quad, errors of place", misplaced_sweep, "quad_bench", ("R_m", "body_lift.K_b")),
            ("quad, off the grid", off_grid_sweep, "quad_bench", ("R_m", "body_lift.K_b")),
            ("single, wandering zero", wandering_sweep, "single_bench", ("R_m",)),
        )
        for basis in ("joint", "equal_rpm2")
    ),
    *(
        Cell(
            name=name,
            sweep=sweep,
            model="quad_bench",
            counted=("k",),
            options={"rig": "pquad", "walkers": 24},  # two for each free parameter at least
        )
        for name, sweep in (
            ("quad, one load cell of five masses", one_calibration),
            ("quad, two load cells of five masses", two_calibrations),
            ("quad, three load cells of five masses", three_calibrations),
        )
    ),
)
