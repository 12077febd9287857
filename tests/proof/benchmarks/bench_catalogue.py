"""Time the catalogue: python tests/proof/benchmarks/bench_catalogue.py [RUNS] [ROWS] [linked]

Makes run folders of five rigs below build/, times list, search and queries against DuckDB
statements written by hand for the same files, each in a process of its own, and says how much
memory it took. With `linked` the samples of all runs are one file under many names: as many rows as
on a disk that holds them, but read from the system's cache.
"""

from __future__ import annotations

import json
import os
import shutil
import statistics
import subprocess
import sys
from pathlib import Path
from time import perf_counter
from typing import Any

import pyarrow.parquet as pq

from benchtool.data.atomic import file_hash
from benchtool.data.catalogue.index import load_entries
from benchtool.data.columns import find_channel
from benchtool.data.parquet import write_parquet
from benchtool.data.run.read import read_samples

TOP = Path(__file__).parents[3]
SOURCE = TOP / "datasets" / "quad" / "run"
PLACE = TOP / "build" / "catalogue"
ROOT = PLACE / "runs"
REPEATS = 5

SETTINGS = (
    "SELECT round(z_over_r, 3) AS z, avg(ratio_equal_rpm2) AS ratio FROM {} "
    "WHERE rig = 'rig2' AND kind = 'measure' GROUP BY 1 ORDER BY 1"
)
SETTINGS_BY_HAND = (
    "SELECT round(plate_z_m, 3) AS z, avg(ratio_equal_rpm2) AS ratio FROM read_csv(FILES) "
    "WHERE kind = 'measure' GROUP BY 1 ORDER BY 1"
)
SAMPLES = (
    "SELECT round(plate_z_m, 4) AS z, avg(thrust_N) AS thrust_N FROM {} "
    "WHERE phase = 'sample' GROUP BY 1 ORDER BY 1"
)

TIMED = """
import resource, sys, time
{}
print(time.perf_counter() - start, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
"""

OURS = """
import benchtool as bt
found = bt.runs({root!r}, {by})
start = time.perf_counter()
rows = found.query({sql!r})
"""

BY_HAND = """
import duckdb, glob, json
files = {files}
start = time.perf_counter()
base = duckdb.connect()
rows = base.sql({sql!r}.replace("FILES", str(files))).df()
"""


def make_runs(runs: int, rows: int, *, linked: bool) -> None:
    """Make run folders whose samples are one run's own, taken as often as needed."""
    ROOT.mkdir(parents=True)
    samples = read_samples(SOURCE)
    repeats = -(-rows // len(samples))
    import numpy as np

    values = np.tile(samples.values, (repeats, 1))[:rows]
    whole = type(samples)(tuple(map(find_channel, samples.names)), values)
    write_parquet(PLACE / "samples.parquet", whole)
    facts: dict[str, Any] = json.loads((SOURCE / "metadata.json").read_text("utf-8"))
    facts["samples"] = {"parquet_sha256": file_hash(PLACE / "samples.parquet")}
    for number in range(runs):
        folder = ROOT / f"{2020 + number % 7}" / f"run{number:05}"
        folder.mkdir(parents=True)
        for name in ("plan.toml", "points.csv", "settings.csv", "events.jsonl"):
            shutil.copyfile(SOURCE / name, folder / name)
        place = os.link if linked else shutil.copyfile
        place(PLACE / "samples.parquet", folder / "samples.parquet")
        own = facts | {
            "started": f"{2020 + number % 7}-{1 + number % 12:02}-{1 + number % 28:02}T10:00+00:00",
            "operator": ("ada", "bob", "cy")[number % 3],
            "rig": facts["rig"] | {"name": f"rig{number % 5}"},
        }
        (folder / "metadata.json").write_text(json.dumps(own), "utf-8")


def timed(program: str, repeats: int = REPEATS) -> tuple[float, float]:
    """Return the median time (s) and the largest memory (MiB) of a program, run several times."""
    results = []
    for _ in range(repeats):
        out = subprocess.run(
            [sys.executable, "-c", TIMED.format(program)],
            capture_output=True,
            text=True,
            check=True,
        )
        results.append([float(one) for one in out.stdout.split()[-2:]])
    times, memory = zip(*results, strict=True)
    return statistics.median(times), max(memory)


def command_time(*words: str) -> float:
    """Return the median wall time of a command from its start to its end: s."""
    times = []
    for _ in range(REPEATS):
        start = perf_counter()
        subprocess.run(
            [sys.executable, "-m", "benchtool", "runs", *words, "--folder", str(ROOT)],
            stdout=subprocess.DEVNULL,
            check=True,
        )
        times.append(perf_counter() - start)
    return statistics.median(times)


def main() -> None:
    """Print a line for each thing that is timed."""
    runs, rows = (int(word) for word in (*sys.argv[1:3], "1000", "10000")[:2])
    os.environ["BENCHTOOL_STATE"] = str(PLACE / "state")
    shutil.rmtree(PLACE, ignore_errors=True)
    make_runs(runs, rows, linked="linked" in sys.argv)
    print(
        f"{runs:,} runs, {runs * rows:,} rows of {len(pq.read_schema(PLACE / 'samples.parquet'))}"
    )
    start = perf_counter()
    assert len(load_entries(ROOT)) == runs
    print(f"index made: {perf_counter() - start:.1f} s")
    print(f"list --rig rig2: {command_time('list', '--rig', 'rig2'):.3f} s")
    print(f"list: {command_time('list'):.3f} s")
    print(f"search: {command_time('search', 'run00042 ada'):.3f} s")
    hand = json.dumps
    paths = sorted(ROOT.glob("*/*/samples.parquet"))
    listed, all_listed = PLACE / "files.json", PLACE / "all.json"
    all_listed.write_text(hand([str(path) for path in paths]), "utf-8")
    rig2 = [str(path) for path in paths if int(path.parent.name[3:]) % 5 == 2]
    listed.write_text(hand(rig2), "utf-8")
    settings = PLACE / "settings.json"
    settings.write_text(hand([str(Path(one).with_name("settings.csv")) for one in rig2]), "utf-8")
    for name, ours, files, by_hand in (
        ("settings", SETTINGS.format("settings"), f"json.load(open({str(settings)!r}))",
         SETTINGS_BY_HAND),
        ("samples", SAMPLES.format("samples"), f"json.load(open({str(listed)!r}))",
         SAMPLES.format("read_parquet(FILES)")),
    ):  # fmt: skip
        one, memory = timed(OURS.format(root=str(ROOT), by="rig='rig2'", sql=ours))
        other, least = timed(BY_HAND.format(files=files, sql=by_hand))
        print(
            f"{name} of rig2: {one:.3f} s, by hand {other:.3f} s ({one / other:.2f} times); "
            f"{memory:.0f} MiB, by hand {least:.0f} MiB",
            flush=True,
        )
    # Every sample row of every run, once in one and once in the other order.
    sql = SAMPLES.format("samples")
    ours = OURS.format(root=str(ROOT), by="", sql=sql)
    by_hand = BY_HAND.format(
        files=f"json.load(open({str(all_listed)!r}))", sql=SAMPLES.format("read_parquet(FILES)")
    )
    turns = [timed(each, 1) for each in (ours, by_hand, by_hand, ours)]
    one, other = (turns[0][0] + turns[3][0]) / 2, (turns[1][0] + turns[2][0]) / 2
    print(
        f"samples of all runs: {one:.2f} s, by hand {other:.2f} s ({one / other:.2f} times); "
        f"{turns[3][1]:.0f} MiB, by hand {turns[1][1]:.0f} MiB"
    )


if __name__ == "__main__":
    main()
