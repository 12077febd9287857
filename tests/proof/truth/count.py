"""Count how often the intervals of every cell hold the truth: `make coverage-truth`.

Trials are stored as they are done, by the sources they were counted with: a count that was cut
short goes on where it was, and one of other sources begins anew.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from scipy.special import stdtrit
from scipy.stats import binomtest, chi2

from benchtool.fit.recipe import Method
from benchtool.fit.run_recipe import FitOutput, run_recipe
from benchtool.tasks import TaskStore, run_tasks
from tests.long_count import sources_hash
from tests.proof.truth.cells import CELLS, Cell, Sweep

LEVELS = (0.6827, 0.95)
FIRST_SEED = 3000  # seeds from here on are counted; nothing was ever chosen by looking at them

NORMAL_TAILS = 2.1
"""Widths of 95 over 68 % intervals: 1.96 of a normal distribution, 2.1 at 17 degrees of freedom."""

BATCH = 40  # trials of one sweep before the next one's, so that a count cut short has some of each

STORE = Path("build/coverage-truth")
BEGIN, END = "<!-- counts -->", "<!-- end of counts -->"
"""Lines of a page between which the table stands."""

METHODS: tuple[Method, ...] = ("least_squares", "emcee")


@dataclass(frozen=True, slots=True)
class Held:
    """Hold what one fit said of one number."""

    truth: float
    value: float
    sd: float
    interval_68: tuple[float, float]
    interval_95: tuple[float, float]

    def holds(self, level: float) -> bool:
        """Whether the interval of that probability holds the truth."""
        low, high = self.interval_68 if level == LEVELS[0] else self.interval_95
        return low <= self.truth <= high


Trial = dict[str, dict[str, Held]]
"""What one sweep's fits said: {cell: {number: held}}; a cell without a fit is left out."""


def run_trial(sweep: Sweep, method: Method, seed: int, cells: Sequence[Cell] = CELLS) -> Trial:
    """Sweep one bench and fit it as every cell of that sweep says."""
    found: Trial = {}
    with TemporaryDirectory() as folder:
        run = Path(folder) / "run"
        truth = sweep(seed, run)
        for cell in cells:
            if cell.sweep is not sweep or not cell.counts(method):
                continue
            output = run_recipe(cell.recipe(run, (method,), seed + 1))
            held = _of_budget if cell.budget else _of_fit
            found[cell.name] = {name: held(output, name, truth[name]) for name in cell.counted}
    return found


def _of_fit(output: FitOutput, name: str, truth: float) -> Held:
    item = output.results[0][name]
    return Held(truth, item.value, item.sd, item.interval_68, item.interval_95)


def _of_budget(output: FitOutput, name: str, truth: float) -> Held:
    budget = output.budget
    assert budget is not None
    place = budget.names.index(name)
    value, sd = budget.values[place], float(budget.combined[place])
    one = float(stdtrit(budget.dof[place], 0.5 + 0.5 * LEVELS[0])) * sd
    two = float(budget.expanded[place])
    return Held(truth, value, sd, (value - one, value + one), (value - two, value + two))


@dataclass(frozen=True, slots=True)
class Count:
    """Hold the count of one number of one cell."""

    cell: str
    method: str
    name: str
    trials: int
    held: tuple[int, int]  # how many of the 68 % and of the 95 % intervals hold the truth
    rms_z: float  # of (value - truth)/sd
    width: float  # median half width of the 68 % intervals over the rms of value - truth
    tails: float = 1.96  # median of the widths of the 95 % intervals over those of the 68 % ones
    mean_z: float = 0.0

    def misses(self, confidence: float) -> list[float]:
        """Return the levels that the Wilson interval of the count does not hold."""
        missed = []
        for level, held in zip(LEVELS, self.held, strict=True):
            found = binomtest(held, self.trials).proportion_ci(confidence, method="wilson")
            if not found.low <= level <= found.high:
                missed.append(level)
        return missed

    @property
    def z_is_one(self) -> bool:
        """Whether rms z is within the 99.9 % limits that so many normal draws allow.

        Student's t of few degrees of freedom has no such limits.
        """
        if self.tails > NORMAL_TAILS:
            return True
        low, high = chi2.ppf([0.0005, 0.9995], self.trials) / self.trials
        return bool(low <= self.rms_z**2 <= high)

    @property
    def is_biased(self) -> bool:
        """Whether mean z is beyond the 99.9 % limits that so many normal draws allow."""
        return self.tails <= NORMAL_TAILS and abs(self.mean_z) > 3.29 / self.trials**0.5

    @property
    def off(self) -> float:
        """How far the counts are off, in standard deviations of a right count."""
        return max(
            abs(held - level * self.trials) / (level * (1.0 - level) * self.trials) ** 0.5
            for level, held in zip(LEVELS, self.held, strict=True)
        )


def counted(trials: Sequence[Trial], method: Method) -> list[Count]:
    """Return the counts of all numbers in trials."""
    keys = {(cell, name): None for trial in trials for cell in trial for name in trial[cell]}
    counts = []
    for cell, name in keys:
        own = [trial[cell][name] for trial in trials if cell in trial]
        left = np.array([one.value - one.truth for one in own])
        z = left / [one.sd for one in own]
        half, wide = (
            np.array([0.5 * float(np.diff(getattr(one, name))[0]) for one in own])
            for name in ("interval_68", "interval_95")
        )
        at_68, at_95 = (sum(one.holds(level) for one in own) for level in LEVELS)
        counts.append(
            Count(
                cell=cell,
                method=method,
                name=name,
                trials=len(own),
                held=(at_68, at_95),
                rms_z=float(np.sqrt(np.mean(z**2))),
                width=float(np.median(half) / np.sqrt(np.mean(left**2))),
                tails=float(np.median(wide / half)),
                mean_z=float(np.mean(z)),
            )
        )
    return counts


def faults(counts: Sequence[Count]) -> list[str]:
    """Return what is wrong with intervals, in words; nothing where they are as they should be.

    Each count is held against its 99.9 % Wilson interval and the limits of mean and rms z, and of
    all together at most one in ten may miss at 95 %.
    """
    found = []
    for count in counts:
        where = f"{count.cell}, {count.method}, {count.name}"
        for level in count.misses(0.999):
            held = count.held[LEVELS.index(level)]
            found.append(f"{where}: {held} of {count.trials} intervals of {level:.0%} hold")
        if not count.z_is_one:
            found.append(f"{where}: rms z is {count.rms_z:.2f} over {count.trials} trials")
        if count.is_biased:
            found.append(f"{where}: mean z is {count.mean_z:+.2f} over {count.trials} trials")
    missed, whole = sum(len(one.misses(0.95)) for one in counts), len(LEVELS) * len(counts)
    if missed > 0.1 * whole:
        found.append(f"{missed} of {whole} counts miss at 95 %, at most one in ten may")
    return found


def table(counts: Sequence[Count]) -> str:
    """Return the counts as a table in Markdown, those farthest off first."""
    lines = [
        "| bench, basis | method | number | trials | 68 % | 95 % | mean z | rms z | width |",
        f"{'|---' * 9}|",
    ]
    for one in sorted(counts, key=lambda one: -one.off):
        at_68, at_95 = (f"{held / one.trials:.1%}".replace("%", " %") for held in one.held)
        lines.append(
            f"| {one.cell} | {one.method} | {one.name} | {one.trials} | {at_68} | {at_95} "
            f"| {one.mean_z:+.2f} | {one.rms_z:.2f} | {one.width:.2f} |"
        )
    return "\n".join(lines)


def cells_of(trial: tuple[Sweep, Method, int]) -> dict[str, dict[str, list[Any]]]:
    """Return a trial's numbers as JSON holds them."""
    return {
        cell: {name: list(astuple(one)) for name, one in numbers.items()}
        for cell, numbers in run_trial(*trial).items()
    }


def trial_of(cells: dict[str, dict[str, list[Any]]]) -> Trial:
    """Return the trial that was stored so."""
    return {
        cell: {name: Held(*fit[:3], tuple(fit[3]), tuple(fit[4])) for name, fit in numbers.items()}
        for cell, numbers in cells.items()
    }


def planned(
    methods: Sequence[Method], trials: int, names: Sequence[str] = ()
) -> dict[str, tuple[Sweep, Method, int]]:
    """Return what is counted, by name: some trials of each sweep before the next ones.

    Args:
        names: of the sweeps; all of them when empty.
    """
    return {
        f"{sweep.__name__} {method} {seed}": (sweep, method, seed)
        for method in methods
        for first in range(0, trials, BATCH)
        for sweep in dict.fromkeys(cell.sweep for cell in CELLS if cell.counts(method))
        if not names or sweep.__name__ in names
        for seed in range(FIRST_SEED + first, FIRST_SEED + min(first + BATCH, trials))
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Count, print the table and what is wrong; return 1 where something is."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=400)
    parser.add_argument("--processes", type=int, default=None)
    parser.add_argument("--cluster", help="address of a Dask scheduler whose workers count")
    parser.add_argument("--method", action="append", choices=METHODS)
    sweeps = sorted({cell.sweep.__name__ for cell in CELLS})
    parser.add_argument("--sweep", action="append", choices=sweeps, help="count this one alone")
    parser.add_argument("--stored", action="store_true", help="judge what is stored, count no more")
    parser.add_argument("--page", type=Path, help="write the table into this page")
    asked = parser.parse_args(arguments)
    methods = asked.method or METHODS
    plan = planned(methods, asked.trials, asked.sweep or ())
    found: dict[tuple[Sweep, Method], list[Trial]] = {}
    path = STORE / f"{sources_hash('benchtool', 'tests/proof/truth')}.jsonl"
    with TaskStore(path, {}) as store:
        if asked.stored:
            plan = {name: item for name, item in plan.items() if name in store}
        for done, (name, cells) in enumerate(
            run_tasks(
                cells_of, plan, store=store, cluster=asked.cluster, processes=asked.processes
            ),
            1,
        ):
            found.setdefault(plan[name][:2], []).append(trial_of(cells))
            if done % BATCH == 0:
                print(f"{done} of {len(plan)} trials", file=sys.stderr, flush=True)
    counts = [
        one
        for method in methods
        for (_, counted_by), trials in found.items()
        if counted_by == method
        for one in counted(trials, method)
    ]
    wrong = "\n".join(faults(counts)) or "every count is within its limits"
    print(table(counts), wrong, sep="\n")
    if asked.page:
        before, _, rest = asked.page.read_text("utf-8").partition(BEGIN)
        after = rest.partition(END)[2]
        said = wrong.replace("\n", "\n- ")
        text = f"{before}{BEGIN}\n{table(counts)}\n\nWhat misses:\n\n- {said}\n{END}{after}"
        asked.page.write_text(text, "utf-8")
    return 1 if faults(counts) else 0


if __name__ == "__main__":
    sys.exit(main())
