"""Print how fast the pitch bench runs beside another checkout: `bench_pitch_beside.py CHECKOUT`.

Both run the scenario of their own `bench_pitch.py` in processes of their own, in turns, each with
its `.venv`; processor time of the best round counts, so that what else the machine does falls on
both alike. A ratio above 1 says that this checkout is quicker.
"""

from __future__ import annotations

import inspect
import json
import subprocess
import sys
import time
from collections.abc import Callable
from itertools import count
from pathlib import Path

ROUNDS, REPEATS, RUNS = 3, 5, 320
HERE = Path(__file__).parents[3]


def cpu_s(run: Callable[[], object], rounds: int) -> float:
    """Return the least processor time of some rounds, of all threads."""
    found = []
    for _ in range(rounds):
        began = time.process_time()
        run()
        found.append(time.process_time() - began)
    return min(found)


def measured() -> dict[str, float]:
    """Return simulated seconds, and runs, per second of the present folder's checkout."""
    sys.path[:0] = ["", "tests/proof/benchmarks"]
    import bench_pitch as bench

    job, schedule = bench.scenario()
    numbered = "first_run" not in inspect.signature(bench.simulate_many).parameters

    def batch() -> None:
        jobs = zip([job] * RUNS, count(), strict=False) if numbered else [job] * RUNS
        list(bench.simulate_many(jobs, schedule, bench.squared, threads=1))

    runs: dict[str, tuple[Callable[[], object], float]] = {
        "single run, times real time": (
            lambda: bench.simulate_pitch(job, schedule), bench.DURATION_S,
        ),
        "controller in Python, times real time": (
            lambda: bench.simulate_controller(bench.OwnPid(), job, schedule), bench.DURATION_S,
        ),
        "batch on one thread, runs/s": (batch, float(RUNS)),
    }  # fmt: skip
    for run, _ in runs.values():
        run()
    return {name: amount / cpu_s(run, REPEATS) for name, (run, amount) in runs.items()}


def main(other: Path) -> None:
    """Measure both in turns and print."""
    best: dict[Path, dict[str, float]] = {HERE: {}, other.resolve(): {}}
    for _ in range(ROUNDS):
        for checkout, found in best.items():
            output = subprocess.run(
                [checkout / ".venv/bin/python", __file__], cwd=checkout, check=True,
                capture_output=True, text=True,
            )  # fmt: skip
            for name, speed in json.loads(output.stdout.splitlines()[-1]).items():
                found[name] = max(found.get(name, 0.0), speed)
    here, there = best.values()
    for name, speed in here.items():
        ratio = speed / there[name]
        print(f"{name:<38} {speed:>7.0f} here {there[name]:>7.0f} there, ratio {ratio:.2f}")


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(Path(sys.argv[1]))
    else:
        print(json.dumps(measured()))
