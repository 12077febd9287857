"""Points and settings of many runs, and values of many fits, as a few Parquet files by the index.

Rows are read once from points.csv, settings.csv and result.json, and again when a folder changes.
They have a number; rows whose number the index no longer names are left out, and go when files are
merged.
"""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Iterable, Sequence
from contextlib import closing
from pathlib import Path
from time import time
from typing import Any
from uuid import uuid4

from benchtool.core.errors import BenchtoolError
from benchtool.data.atomic import read_json
from benchtool.data.catalogue.entry import SWEEPS, Entry
from benchtool.data.catalogue.index import connect, index_folder

TABLES = {"points": SWEEPS, "settings": SWEEPS, "fits": ("fit",)}
"""Tables that are stored, and the kinds of the entries that have rows in them."""

RUNS_AT_ONCE = 2000
"""Runs whose rows are in memory at once: 50 MB of them. A choice."""

MOST_FILES = 8
"""Files that a query reads before they are merged into one; a choice."""

UNUSED_S = 3600.0
"""A file that no index names may still be read by a query that began before; a choice."""


def row_numbers(
    root: Path, entries: Sequence[Entry], kinds: Sequence[str]
) -> tuple[list[int], list[Path]]:
    """Return the numbers of the rows of some runs or fits, and the folders of files with them.

    What is missing is read from them first; one that cannot be read has no rows.

    Args:
        entries: of one folder, as its index has them now; those of other kinds are left out.
    """
    folder = index_folder(root)
    with closing(connect(folder)) as store:
        _make(store)
        stamps = dict(store.execute("SELECT name, stamp FROM entry"))
        known = _known(store)
        own = [entry for entry in entries if entry.kind in kinds and entry.name in stamps]
        new = [one for one in own if known.get(one.name, ("",))[0] != stamps[one.name]]
        for start in range(0, len(new), RUNS_AT_ONCE):
            _write(store, folder, root, new[start : start + RUNS_AT_ONCE], stamps)
        if new:
            _merge(store, folder)
        known = _known(store)
        # One that cannot be read any more keeps no rows of earlier.
        rows = [row for one in own if (row := known.get(one.name)) and row[0] == stamps[one.name]]
    return [row[1] for row in rows], [folder / name for name in sorted({row[2] for row in rows})]


def _make(store: sqlite3.Connection) -> None:
    store.execute(
        "CREATE TABLE IF NOT EXISTS stored "
        "(name TEXT PRIMARY KEY, stamp TEXT, number INTEGER, file TEXT)"
    )


def _known(store: sqlite3.Connection) -> dict[str, tuple[str, int, str]]:
    rows = store.execute("SELECT name, stamp, number, file FROM stored")
    return {name: (stamp, number, file) for name, stamp, number, file in rows}


def _write(
    store: sqlite3.Connection,
    folder: Path,
    root: Path,
    entries: Iterable[Entry],
    stamps: dict[str, str],
) -> None:
    """Write the rows of runs into new files, and name them in the index afterwards."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    place = folder / uuid4().hex
    place.mkdir()
    parts: dict[str, list[Any]] = {name: [] for name in TABLES}
    rows = []
    for entry in entries:
        number = int.from_bytes(os.urandom(7))
        try:
            for name, tables in _tables_of(root / entry.name, entry).items():
                parts[name] += [_numbered(table, entry, number) for table in tables]
        except (BenchtoolError, KeyError, TypeError, ValueError, AttributeError):
            continue  # the list shows it with its problem
        rows.append((entry.name, stamps[entry.name], number, place.name))
    for name, tables in parts.items():
        if tables:
            table = pa.concat_tables(tables, promote_options="permissive")
            pq.write_table(table, place / f"{name}.parquet", compression="zstd")
    with store:
        store.executemany("INSERT OR REPLACE INTO stored VALUES (?, ?, ?, ?)", rows)


def _tables_of(path: Path, entry: Entry) -> dict[str, list[Any]]:
    """Return the tables of one run or fit; one that it lacks has no part."""
    from benchtool.data.run.entry import radius_of

    if entry.kind == "fit":
        return {"fits": _fit_rows(path)}
    radius_m = radius_of(read_json(path / "metadata.json", follow=False))
    return {name: _run_rows(path / f"{name}.csv", radius_m) for name in ("points", "settings")}


def _run_rows(path: Path, radius_m: float) -> list[Any]:
    import pyarrow as pa
    import pyarrow.compute as pc

    from benchtool.data.run.sample_stream import WholeLines, sample_batches

    if not path.is_file():
        return []
    with WholeLines(path) as lines:
        if lines.lines < 1:
            return []
        table = pa.Table.from_batches(list(sample_batches(lines, path, lines.names)))
    if "plate_z_m" in table.column_names:
        z_over_r = pc.divide(table["plate_z_m"], radius_m)
        table = table.add_column(0, "z_over_r", z_over_r)
    return [table]


def _fit_rows(path: Path) -> list[Any]:
    """Return a row for each parameter and derived quantity by each method."""
    import pyarrow as pa

    from benchtool.data.run.entry import read_result

    facts = read_result(path)
    budget = ((facts.get("budget") or {}).get("quantities")) or {}
    rows = [
        {
            "model": facts["model"], "basis": facts["basis"], "method": method,
            "parameter": name, "value": one["value"], "sd": one["sd"],
            "low_95": one["interval_95"][0], "high_95": one["interval_95"][1],
            "combined_sd": one.get("combined_sd", (budget.get(name) or {}).get("combined")),
            "unit": one["unit"],
            "derived": part == "derived", "outcome": result["outcome"]["status"],
            "verdict": result["facts"].get("verdict", ""), "chi2_per_dof": result["chi2_per_dof"],
            "points": facts["points"]["used"], "simulated": facts["simulated"],
        }
        for method, result in facts["results"].items()
        for part in ("estimates", "derived")
        for name, one in result[part].items()
    ]  # fmt: skip
    numbers = ("value", "sd", "low_95", "high_95", "combined_sd", "chi2_per_dof")
    table = pa.Table.from_pylist(rows)
    for name in numbers if rows else ():  # whole numbers and a missing one are numbers, too
        place = table.column_names.index(name)
        table = table.set_column(place, name, table[name].cast(pa.float64()))
    return [table] if rows else []


def _numbered(table: Any, entry: Entry, number: int) -> Any:
    """Return rows with their number, the name of the run or fit, and its rig."""
    import pyarrow as pa

    own = {"run_number": pa.array([number] * len(table), pa.int64())}
    for name, text in (("run", entry.name), ("rig", entry.rig)):
        codes = pa.array([0] * len(table), pa.int32())
        own[name] = pa.DictionaryArray.from_arrays(codes, pa.array([text]))
    return pa.table({**own, **{name: table[name] for name in table.column_names}})


def _merge(store: sqlite3.Connection, folder: Path) -> None:
    """Make one file of many, without the rows that no run has any more."""
    import pyarrow as pa
    import pyarrow.dataset as ds
    import pyarrow.parquet as pq

    known = _known(store)
    files = {file for _, _, file in known.values()}
    if len(files) > MOST_FILES:
        place = folder / uuid4().hex
        place.mkdir()
        live = pa.array([number for _, number, _ in known.values()])
        for name in TABLES:
            paths = [path for file in files if (path := folder / file / f"{name}.parquet").exists()]
            schemas = [pq.read_schema(path) for path in paths]
            if not schemas:
                continue
            schema = pa.unify_schemas(schemas, promote_options="permissive").remove_metadata()
            scan = ds.dataset([str(path) for path in paths], schema=schema).scanner(
                filter=ds.field("run_number").isin(live)
            )
            with pq.ParquetWriter(place / f"{name}.parquet", schema, compression="zstd") as writer:
                for batch in scan.to_batches():
                    writer.write_batch(batch)
        with store:
            rows = [(place.name, name, number) for name, (_, number, _) in known.items()]
            store.executemany("UPDATE stored SET file = ? WHERE name = ? AND number = ?", rows)
    used = {file for _, _, file in _known(store).values()}
    for item in folder.iterdir():
        if item.is_dir() and item.name not in used and time() - item.stat().st_mtime > UNUSED_S:
            for part in item.iterdir():
                part.unlink(missing_ok=True)
            item.rmdir()
