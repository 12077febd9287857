"""Sweeps one after the other in one process, with random faults on every link, for a given time.

    python -m tests.proof.soak.soak --minutes 60 --seed 1 --every-s 3 --table build/soak.md

After each sweep it is asked of the device whether its motors turned without a live host, and of
the run's folder whether every row that reached the host is there; memory, descriptors and threads
of this process are noted. Its last lines are the tables of docs/explanation/proof.md.
"""

from __future__ import annotations

import argparse
import functools
import gc
import json
import os
import random
import shutil
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import psutil

from benchtool.bench.mavlink.bench import MavlinkBench
from benchtool.bench.serial.bench import SerialBench
from benchtool.data.run.read import read_samples
from tests.faults.dialects import fields_in
from tests.faults.loop import Hangs, command, plan
from tests.long_count import LongCount, Stopped
from tests.proof.soak.world import FAULTS, SoakWorld

KINDS = {"memory": 3, "mavlink": 3, "grbl": 3, "pty": 1, "tcp": 1}  # links, with weights

CODES = (0, 3, 4, 5, 8)
"""Exit codes that a fault may bring; 2 is a mistake of this script, 70 one of the program."""

RESUMED = 0.3  # share of the stopped runs that are resumed


@dataclass
class Outcome:
    """What one sweep brought."""

    kind: str
    seed: int
    code: int
    said: str
    time_s: float
    turned_s: float
    rows: int
    struck: dict[str, int]
    troubles: list[str] = field(default_factory=list)
    resumed: bool = False


@contextmanager
def noting_rows(handed: list[np.ndarray]) -> Iterator[None]:
    """Keep the times of all rows that the drivers hand over."""

    def noting(read):
        @functools.wraps(read)
        def noted(bench, duration_s):
            readings = read(bench, duration_s)
            handed.append(np.asarray(readings.device_time_us))
            return readings

        return noted

    with ExitStack() as stack:
        for driver in (SerialBench, MavlinkBench):
            stack.enter_context(mock.patch.object(driver, "read", noting(driver.read)))
        yield


def run(words: list[str], folder: Path, world: SoakWorld, handed: list) -> tuple[int, str]:
    """Run `benchtool WORDS` in a folder; return its exit code and what it said."""
    try:
        with noting_rows(handed):
            outcome = command(words, folder, world)
    except (Exception, Hangs):  # noqa: BLE001 - each is a finding
        return 70, traceback.format_exc()
    finally:
        world.close()
    return outcome.code, outcome.said


def sweep(kind: str, seed: int, every_s: float, folder: Path) -> Outcome:
    """Sweep a plan of random size with random faults, and judge what came of it."""
    rng = random.Random(seed)
    distances = ", ".join(f"{n / 100:.2f}" for n in rng.sample(range(10, 140), rng.randint(1, 3)))
    pulses = ", ".join(f"{n}.0" for n in rng.sample(range(1300, 1700), rng.randint(1, 2)))
    (folder / "plan.toml").write_text(plan(distances, rng.choice((1.0, 2.0, 4.0)), pulses))
    world, handed = SoakWorld(kind, seed, every_s), []
    begun_s = world.now_s
    words = ["--rig", "pquad_single", "--plan", "plan.toml", "--yes", "--out", "run", *world.more]
    code, said = run(["sweep", world.address, *words], folder, world, handed)
    where = folder / "run"
    outcome = Outcome(
        kind, seed, code, said, world.now_s - begun_s, world.turned_s, 0, world.struck
    )
    outcome.troubles += world.unsafe[:3]
    if code not in CODES:
        outcome.troubles.append(f"exit code {code}: {said[-3000:]}")
    if (where / "samples.csv").exists():
        outcome.rows = judge_rows(where, world, handed, outcome)
        stopped = json.loads((where / "metadata.json").read_text())["state"] == "stopped"
        if stopped and not world.is_real and rng.random() < RESUMED:
            resume(folder, outcome)
    elif code == 0:
        outcome.troubles.append("exit code 0 without a run")
    return outcome


def resume(folder: Path, outcome: Outcome) -> None:
    """Go on with a stopped run on a link without faults: it ends, and keeps what it has."""
    before = read_samples(folder / "run").column("thrust_N")
    world = SoakWorld(outcome.kind, outcome.seed, inf)
    words = ["sweep", world.address, "--resume", "run", "--yes", *world.more]
    code, said = run(words, folder, world, [])
    outcome.resumed = True
    after = read_samples(folder / "run").column("thrust_N")
    if code != 0 or world.unsafe:
        outcome.troubles.append(f"resumed: exit code {code}, {world.unsafe[:3]}: {said[-3000:]}")
    if not np.array_equal(after[: len(before)], before, equal_nan=True):
        outcome.troubles.append("resumed: rows that were stored have changed")


def judge_rows(run: Path, world: SoakWorld, handed: list[np.ndarray], outcome: Outcome) -> int:
    """Note every row that is not where it should be; return how many are stored."""
    facts = json.loads((run / "metadata.json").read_text())
    events = (run / "events.jsonl").read_text()
    # What fails after the last point (the ramp down, the link at its closing) leaves nothing to do.
    measured = '"text": "closed afterwards; all is measured' in events or '"ended"' in events
    if facts["state"] != ("ended" if outcome.code == 0 or measured else "stopped"):
        outcome.troubles.append(f"exit code {outcome.code}, state {facts['state']}")
    if not (run / "samples.csv").read_bytes().endswith(b"\n"):
        outcome.troubles.append("the last row is torn")
    stored_us = read_samples(run).column("device_time_us")
    if len(stored_us) != facts["link"]["samples"]:
        outcome.troubles.append(f"{len(stored_us)} rows, {facts['link']['samples']} counted")
    times_us = stored_us[np.isfinite(stored_us)]
    if not len(times_us):
        return len(stored_us)
    if not np.all(np.diff(times_us) > 0.0):
        outcome.troubles.append("rows are not in the order of their times")

    def missing(given_us: np.ndarray) -> np.ndarray:
        inside = (given_us >= times_us[0]) & (given_us <= times_us[-1])
        return np.setdiff1d(given_us[inside], times_us)

    read_us = np.concatenate(handed)
    if len(lost_us := missing(read_us)):
        outcome.troubles.append(f"{len(lost_us)} rows were read and not stored, {lost_us[:3]}")
    lines = map(fields_in, bytes(world.proxy.delivered).split(b"\n"))
    came_us = np.array([float(words[2]) for words in lines if words[:1] == ["S"]])
    # A sample that comes after later ones were handed on is left out, and counted as repeated.
    late = len(missing(came_us))
    if late > facts["link"]["repeated"]:
        outcome.troubles.append(f"{late} rows came and were not stored: {facts['link']}")
    return len(stored_us)


def state_of_process() -> dict[str, float]:
    """Return memory in MB, open descriptors and threads of this process."""
    gc.collect()
    this = psutil.Process()
    return {
        "memory, MB": this.memory_info().rss / 1e6,
        "descriptors": this.num_fds(),
        "threads": this.num_threads(),
    }


def soak(minutes: float, seed: int, every_s: float, notes: Path) -> bool:
    """Sweep until the time is over; write a line for each sweep as it ends.

    Returns:
        Whether it ended by itself; else somebody has stopped it.
    """
    rng, begun_s = random.Random(seed), time.monotonic()
    with LongCount(notes, None, "sweeps", resumes=False) as count:
        while time.monotonic() < begun_s + 60.0 * minutes:
            kind = rng.choices(list(KINDS), list(KINDS.values()))[0]
            folder = Path(tempfile.mkdtemp(prefix="soak-"))
            try:
                outcome = sweep(kind, rng.randrange(1 << 30), every_s, folder)
                line = vars(outcome) | {"said": "", "wall_s": time.monotonic() - begun_s}
                count.add(json.dumps(line | state_of_process()))
            except Stopped:
                shutil.rmtree(folder)
                return False
            if outcome.troubles:
                print(f"sweep {len(count.lines)}, {kind}, seed {outcome.seed}: {outcome.troubles}")
                print(f"its folder: {folder}", flush=True)
            else:
                shutil.rmtree(folder)
    return True


BLOCKS, WARM, FEWEST = 20, 0.1, 100
"""Means of so many blocks make a slope, after that share of the sweeps; fewest sweeps for one."""


def slope(values: np.ndarray) -> tuple[float, float]:
    """Return a slope per 1000 sweeps and its standard error, from means of blocks.

    What follows one another is alike; the means of blocks are so much less.
    """
    warm = values[int(WARM * len(values)) :]
    blocks = np.array_split(warm, min(BLOCKS, len(warm)))
    y = np.array([block.mean() for block in blocks])
    x = np.cumsum([len(block) for block in blocks]) / 1000.0
    x = x - x.mean()
    rise = float(x @ y / (x @ x))
    left = y - y.mean() - rise * x
    return rise, float(np.sqrt(left @ left / max(len(y) - 2, 1) / (x @ x)))


def shown(seconds: float) -> str:
    """Return a time, in hours where there are some."""
    return f"{seconds / 3600.0:.2f} h" if seconds >= 360.0 else f"{seconds:.0f} s"


def tables(notes: Path) -> tuple[str, int]:
    """Return the tables of a soak, and how much was not as it should be."""
    lines: list[dict[str, Any]] = [json.loads(line) for line in notes.read_text().splitlines()]
    if not lines:
        return "no sweep has ended\n", 1
    rows = [
        "| link | sweeps | faults | time of host and links | motors turned | rows | exit codes "
        "| resumed | rows lost, unsafe or wrong |",
        "|---|---|---|---|---|---|---|---|---|",
    ]

    def row(name: str, some: list[dict[str, Any]]) -> str:
        codes = Counter(line["code"] for line in some)
        said = ", ".join(f"{code}: {count}" for code, count in sorted(codes.items()))
        faults = sum(sum(line["struck"].values()) for line in some)
        times = [shown(sum(line[key] for line in some)) for key in ("time_s", "turned_s")]
        wrong = sum(map(bool, (line["troubles"] for line in some)))
        return (
            f"| {name} | {len(some):,} | {faults:,} | {' | '.join(times)} | "
            f"{sum(line['rows'] for line in some):,} | {said} | "
            f"{sum(line['resumed'] for line in some)} | {wrong} |"
        )

    of_kind = {kind: [line for line in lines if line["kind"] == kind] for kind in KINDS}
    rows += [row(name, some) for name, some in [*of_kind.items(), ("all", lines)] if some]
    struck = {kind: sum(line["struck"][kind] for line in lines) for kind in FAULTS}
    rows += ["", "Faults: " + ", ".join(f"{count:,} {kind}" for kind, count in struck.items()), ""]
    rows += ["| of the process | first | last | slope per 1000 sweeps |", "|---|---|---|---|"]
    wrong = [
        f"{line['kind']}, seed {line['seed']}: {line['troubles'][0][:200]}"
        for line in lines
        if line["troubles"]
    ]
    for name in state_of_process():
        values = np.array([line[name] for line in lines])
        warm = values[int(WARM * len(values)) :]
        said = "too few sweeps for a slope"
        if len(lines) >= FEWEST:
            rise, error = slope(values)
            said = f"{rise:+.2f} ± {error:.2f}"
            # Descriptors and threads are whole: one more at the end is a leak.
            limit = 0.05 * warm[0] if name.startswith("memory") else 0.0
            if rise > 3.0 * error and warm[-1] > warm[0] + limit:
                wrong.append(f"{name}: grows by {said} per 1000 sweeps")
        rows.append(f"| {name} | {warm[0]:.1f} | {warm[-1]:.1f} | {said} |")
    rows += ["", f"{shown(lines[-1]['wall_s'])} of wall time, load of the machine at its end "
             f"{', '.join(f'{load:.1f}' for load in os.getloadavg())}", ""]  # fmt: skip
    rows += [f"wrong: {what}" for what in wrong] or ["0 rows lost, 0 unsafe"]
    return "\n".join(rows) + "\n", len(wrong)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--every-s", type=float, default=3.0, help="mean time between two faults")
    parser.add_argument("--table", type=Path, default=Path("build/soak.md"))
    given = parser.parse_args()
    given.table.parent.mkdir(parents=True, exist_ok=True)
    notes = given.table.with_suffix(".jsonl")
    ended = soak(given.minutes, given.seed, given.every_s, notes)
    text, wrong = tables(notes)
    given.table.write_text(text)
    print(text, end="")
    if not ended:
        print("stopped; the table is of the sweeps until then")
    sys.exit(min(wrong, 1) if ended else 130)


if __name__ == "__main__":
    main()
