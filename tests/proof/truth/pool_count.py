"""Count how often intervals of pooled rigs hold the truth, and how often a difference is false.

`draws`: rigs made of normal errors, tau from its prior, 0, or a multiple of the rigs' own errors.
`benches`: points of four quadrotors with drawn errors of every source of the budget, fitted by the
command's recipe; the rigs are equal, or the last has an R a tenth larger.

python -m tests.proof.truth.pool_count draws --trials 1000
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from scipy.stats import binomtest

from benchtool.fit.pool import RigValues, pool_rigs
from benchtool.fit.result_file import write_result
from benchtool.tasks import TaskStore, run_tasks
from tests.long_count import sources_hash
from tests.proof.truth.budgets import budget_sweep

Draw = tuple[int, str, int]  # rigs; "prior", or tau in units of the rigs' own errors; seed

SIZES = (2, 3, 5, 10)
SPREADS = ("prior", "0", "1", "4")
BENCHES = 4
NOTHING, LARGER = "equal", "last larger"

STORE = Path("build/pool-truth")


def counted_draw(item: Draw) -> dict[str, Any]:
    """Return what the intervals of one draw of rigs hold."""
    rigs, spread, seed = item
    rng = np.random.default_rng([20261124, rigs, seed])
    sd = rng.uniform(0.5, 2.0, rigs)
    scale = float(np.sqrt(rigs / np.sum(sd**-2)))
    u = rng.uniform()
    tau = scale * (u / (1.0 - u) if spread == "prior" else float(spread))
    truth = tau * rng.standard_normal(rigs)
    values = truth + sd * rng.standard_normal(rigs)
    found = pool_rigs(
        [
            RigValues(name=str(k), names=("x",), values=values[k : k + 1],
                      covariance=np.array([[sd[k] ** 2]]))
            for k in range(rigs)
        ],
        ["x"],
        seed=seed,
    )  # fmt: skip
    low, high = found.tau_95("x")
    ends = np.quantile(found.mean, [0.025, 0.975])
    pairs = found.differences["x"]
    true = [truth[int(one.rig)] - truth[int(one.other)] for one in pairs]
    held = [
        one.interval_95[0] <= each <= one.interval_95[1]
        for one, each in zip(pairs, true, strict=True)
    ]
    first = next(k for k, one in enumerate(pairs) if {one.rig, one.other} == {"0", "1"})
    wrong = [
        one.is_significant and (each == 0.0 or one.value * each < 0.0)
        for one, each in zip(pairs, true, strict=True)
    ]
    return {
        "cell": f"{rigs} rigs, tau {spread}",
        "tau": bool(low <= tau <= high),
        "mean": bool(ends[0] <= 0.0 <= ends[1]),
        "difference": bool(held[first]),
        "false": bool(wrong[first]),
        "any false": any(wrong),
        "real": bool(pairs[first].is_significant),
    }


def counted_benches(item: tuple[str, str, int]) -> dict[str, Any]:
    """Return what is said of four benches, each with errors of its own."""
    what, shared, seed = item
    import benchtool.api as bt

    with TemporaryDirectory() as name:
        folder = Path(name)
        for k in range(BENCHES):
            radius = 0.132 if what == LARGER and k == BENCHES - 1 else 0.12
            fixed = {"R_m": radius, "body_lift.K_b": 1.9}
            budget_sweep(100_000 + BENCHES * seed + k, folder / f"{k}.csv", fixed)
            output = bt.fit(folder / f"{k}.csv", "quad_bench", rig="pquad").found
            if output.results[0].facts.get("verdict") == "rejected":
                return {"cell": f"{what}{shared}", "rejected": True}
            (folder / str(k)).mkdir()
            write_result(folder / str(k), output)
        folders = [folder / str(k) for k in range(BENCHES)]
        names = {"shared": ["K_b"], "of": ["R_over_rotor_radius"]} if shared else {}
        pooled = bt.pool(folders, seed=seed, **names).found.pooled  # type: ignore[arg-type]
    truth = {"R_over_rotor_radius": [1.0] * BENCHES, "body_lift.K_b": [1.9] * BENCHES}
    if what == LARGER:
        truth["R_over_rotor_radius"][-1] = 1.1
    row: dict[str, Any] = {"cell": f"{what}{shared}"}
    for parameter, pairs in pooled.differences.items():
        true = [truth[parameter][int(one.rig)] - truth[parameter][int(one.other)] for one in pairs]
        short = parameter.partition("_over")[0].rpartition(".")[2]
        same = [one.is_significant for one, each in zip(pairs, true, strict=True) if each == 0.0]
        apart = [one.is_significant for one, each in zip(pairs, true, strict=True) if each != 0.0]
        row[f"{short}: any false"] = any(same)
        if apart:
            row[f"{short}: all found"] = all(apart)
        for one, each in zip(pairs, true, strict=True):
            if {one.rig, one.other} == {"0", str(BENCHES - 1)}:
                row[f"{short}: difference"] = one.interval_95[0] <= each <= one.interval_95[1]
    return row


def sums(rows: Iterable[dict[str, Any]]) -> dict[str, dict[str, tuple[int, int]]]:
    """Return how often each thing was so, and of how many, by cell."""
    yes: dict[str, Counter[str]] = {}
    all_: dict[str, Counter[str]] = {}
    for row in rows:
        cell = row["cell"]
        for key, value in row.items():
            if key != "cell":
                yes.setdefault(cell, Counter())[key] += bool(value)
                all_.setdefault(cell, Counter())[key] += 1
    return {
        cell: {key: (yes[cell][key], count) for key, count in keys.items()}
        for cell, keys in all_.items()
    }


def faults(rows: Iterable[dict[str, Any]]) -> list[str]:
    """Return what is wrong where tau was drawn from its prior: 95 % intervals must hold 95 %."""
    found = []
    for cell, counts in sums(rows).items():
        for key in ("tau", "mean", "difference"):
            if cell.endswith("prior"):
                held, of = counts[key]
                limits = binomtest(held, of).proportion_ci(0.999, method="wilson")
                if not limits.low <= 0.95 <= limits.high:
                    found.append(f"{cell}: {held} of {of} intervals of {key} hold")
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Count, print the table and what is wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("draws", "benches"))
    parser.add_argument("--trials", type=int, default=400)
    parser.add_argument("--cluster", help="address of a Dask scheduler whose workers count")
    asked = parser.parse_args(arguments)
    path = STORE / f"{asked.what}-{sources_hash('benchtool/fit', 'tests/proof/truth')}.jsonl"
    seeds = range(asked.trials)
    rows = []
    with TaskStore(path, {}) as store:
        options: dict[str, Any] = {"store": store, "cluster": asked.cluster}
        if asked.what == "draws":
            draws = [(n, spread, seed) for seed in seeds for n in SIZES for spread in SPREADS]
            found = run_tasks(counted_draw, {str(each): each for each in draws}, **options)
        else:
            kinds = [(w, s, seed) for seed in seeds for w in (NOTHING, LARGER)
                     for s in ("", ", K_b shared")]  # fmt: skip
            found = run_tasks(counted_benches, {str(each): each for each in kinds}, **options)
        rows = [row for _, row in found]
    for cell, counts in sorted(sums(rows).items()):
        shares = (f"{key} {yes}/{of} = {yes / of:.1%}" for key, (yes, of) in counts.items())
        print(f"{cell}: {', '.join(shares)}")
    wrong = faults(rows)
    print("\n".join(wrong) or "every count is within its limits")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
