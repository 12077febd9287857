"""The catalogue of run folders beside DuckDB statements written by hand for the same files."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from benchtool.data.atomic import file_hash
from benchtool.data.catalogue.index import load_entries
from benchtool.data.columns import find_channel
from benchtool.data.parquet import write_parquet
from benchtool.data.run.read import read_samples
from tests.proof.benchmarks.rows import TOP, Row, alone, command_cpu_s, cpu_s

SOURCE = TOP / "datasets" / "quad" / "run"

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

PACKAGES = "import duckdb, pandas"  # both sides import them before the measured work
OURS = "found = bt.runs(arguments[0], **eval(arguments[1])); rows = found.query(arguments[2])"

BY_HAND = (
    "rows = duckdb.connect().sql(arguments[1].replace('FILES', open(arguments[0]).read())).df()"
)


def make_runs(place: Path, runs: int, rows: int) -> None:
    """Make run folders of five rigs that share one file of samples under many names."""
    samples = read_samples(SOURCE)
    repeats = -(-rows // len(samples))
    values = np.tile(samples.values, (repeats, 1))[:rows]
    whole = type(samples)(tuple(map(find_channel, samples.names)), values)
    write_parquet(place / "samples.parquet", whole)
    facts: dict[str, Any] = json.loads((SOURCE / "metadata.json").read_text("utf-8"))
    facts["samples"] = {"parquet_sha256": file_hash(place / "samples.parquet")}
    for number in range(runs):
        folder = place / "runs" / f"{2020 + number % 7}" / f"run{number:05}"
        folder.mkdir(parents=True)
        for name in ("plan.toml", "points.csv", "settings.csv", "events.jsonl"):
            shutil.copyfile(SOURCE / name, folder / name)
        os.link(place / "samples.parquet", folder / "samples.parquet")
        own = facts | {
            "started": f"{2020 + number % 7}-{1 + number % 12:02}-{1 + number % 28:02}T10:00+00:00",
            "operator": ("ada", "bob", "cy")[number % 3],
            "rig": facts["rig"] | {"name": f"rig{number % 5}"},
        }
        (folder / "metadata.json").write_text(json.dumps(own), "utf-8")


def rows(quick: bool) -> Iterator[Row]:
    """Yield the index, commands, and queries of a fifth of all runs and of all."""
    count, samples = (20, 100) if quick else (1000, 10_000)
    with TemporaryDirectory() as folder:
        place = Path(folder)
        root = place / "runs"
        os.environ["BENCHTOOL_STATE"] = str(place / "state")
        make_runs(place, count, samples)
        used_s = cpu_s(lambda: load_entries(root))
        yield Row(f"catalogue, index of {count:,} runs", used_s, "s")
        for words, wanted in (("list --rig rig2", 0.5), ("list", None), ("search ada", None)):
            options = (*words.split(), "--folder", str(root))
            used_s = command_cpu_s("-m", "benchtool", "runs", *options)
            yield Row(f"runs {words}, {count:,} runs", used_s, "s", wanted=wanted)
        paths = sorted(root.glob("*/*/samples.parquet"))
        rig2 = [path for path in paths if int(path.parent.name[3:]) % 5 == 2]
        settings = [path.with_name("settings.csv") for path in rig2]
        by_hand = SAMPLES.format("read_parquet(FILES)")
        for what, by, files, sql, peer_sql in (
            ("settings of a rig", {"rig": "rig2"}, settings, SETTINGS.format("settings"),
             SETTINGS_BY_HAND),
            ("samples of a rig", {"rig": "rig2"}, rig2, SAMPLES.format("samples"), by_hand),
            ("samples of all runs", {}, paths, SAMPLES.format("samples"), by_hand),
        ):  # fmt: skip
            listed = place / "files"
            listed.write_text(str([str(path) for path in files]), "utf-8")
            _, ours, memory_MB = alone(
                f"{PACKAGES}; import benchtool as bt; bt.read", OURS, root, by, sql
            )
            _, peer, _ = alone(PACKAGES, BY_HAND, listed, peer_sql)
            work = f"query, {what}, {count:,} runs"
            yield Row(work, ours, "s", peer, "DuckDB by hand", 1.5, True, memory_MB=memory_MB)
