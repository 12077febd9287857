"""Selection of runs from catalogues, and SQL queries of their tables with DuckDB."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchtool.core.errors import BenchtoolError, InputError, WouldOverwrite
from benchtool.core.inputs import build_inputs
from benchtool.core.keywords import with_keywords
from benchtool.core.text import pluralize
from benchtool.core.user_file import MAX_TABLE_BYTES, read_file
from benchtool.data.catalogue.entry import SWEEPS, ChoiceInputs, Entry
from benchtool.data.catalogue.index import find_entries
from benchtool.data.columns import WORDS, rows_to_frame
from benchtool.data.parquet import load_extra
from benchtool.data.run.state import state_folder

if TYPE_CHECKING:
    import pandas as pd

_TABLES = "runs, settings, points, samples and fits"
SAMPLES = "/samples.parquet"
RUNS_PER_BATCH = 2000  # runs whose tables are parsed together, about 50 MB; assumed
MEMORY_MB = 600  # limit of DuckDB, keeps a query below 1 GiB; assumed

RUN_COLUMNS = (  # of the table `runs`
    "run", "kind", "rig", "propeller", "operator", "started", "state", "simulated",
    "z_over_r_least", "z_over_r_most", "tags", "notes", "summary", "problem",
)  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class RunSelection:
    """Selected runs and results; iterates over their paths, for `bt.fit` and others."""

    entries: Sequence[tuple[Path, Entry]]  # paths with their entries, newest first in each folder

    def __len__(self) -> int:
        return len(self.entries)

    def __iter__(self) -> Iterator[Path]:
        return (path for path, _ in self.entries)

    def __str__(self) -> str:
        return f"{pluralize(len(self), 'run')} and results selected"

    def table(self) -> pd.DataFrame:
        """Return a row for each: run, kind, rig, propeller, operator, UTC date, distances, tags."""
        return rows_to_frame(run_rows(self.entries))

    def query(self, sql: str) -> pd.DataFrame:
        """Return the result of a SELECT from the tables runs, settings, points, samples and fits.

        Raises InputError if DuckDB is not installed or rejects the query.
        """
        with run_query(self.entries, sql) as result:
            table: pd.DataFrame = result.df()
            return table


@with_keywords(ChoiceInputs, omit=("folder",))
def runs(*folders: str | Path, **by: Any) -> RunSelection:
    """Select runs, fits and recordings of folders by their catalogue, as `benchtool runs list`.

    Parameters
    ----------
    *folders : str or Path
        Folders of runs; default: ``runs``.

    Returns
    -------
    RunSelection
        Iterates over paths, for `read` and `fit`; `.table()` returns a data frame, `.query(sql)`
        the result of an SQL query of all points, settings and samples (DuckDB).

    Raises
    ------
    InputError
        A folder does not exist, or an option is unknown.

    Examples
    --------
    >>> import benchtool as bt
    >>> bt.runs(".", rig="pquad_single").table()["kind"].unique().tolist()
    ['sweep']
    """
    options: dict[str, Any] = {"folder": tuple(map(Path, folders))} if folders else {}
    return RunSelection(find_entries(build_inputs(ChoiceInputs, options | by)))


def run_rows(entries: Sequence[tuple[Path, Entry]]) -> list[dict[str, Any]]:
    """Return the rows of the table `runs`."""
    return [
        {
            "run": str(path), "kind": e.kind, "rig": e.rig, "propeller": e.propeller,
            "operator": e.operator, "state": e.state, "simulated": e.simulated,
            "started": e.started and e.started.astimezone(UTC).replace(tzinfo=None),
            "z_over_r_least": e.z_over_r[0] if e.z_over_r else None,
            "z_over_r_most": e.z_over_r[1] if e.z_over_r else None, "tags": list(e.tags),
            "notes": list(e.notes), "summary": e.summary, "problem": e.problem,
        }
        for path, e in entries
    ]  # fmt: skip


@contextmanager
def run_query(entries: Sequence[tuple[Path, Entry]], sql: str) -> Iterator[Any]:
    """Yield DuckDB's relation of one SELECT from the tables of entries."""
    duckdb = load_extra("duckdb", "catalogue", "a query over runs")
    try:
        statements = duckdb.extract_statements(sql)
        if len(statements) != 1 or statements[0].type != duckdb.StatementType.SELECT:
            raise InputError("the query is not a single SELECT; give one SELECT statement")
        with duckdb.connect() as database:
            database.execute(f"SET memory_limit = '{MEMORY_MB}MB'")
            database.execute("SET preserve_insertion_order = false")
            temporary = state_folder() / "catalogue" / "spill"
            database.execute(f"SET temp_directory = {_quote(temporary)}")
            _create_views(database, entries, sql)
            yield database.sql(sql)
    except duckdb.Error as error:
        reason = " ".join(str(error).split())[:300]
        raise InputError(
            f"DuckDB rejects the query: {reason}; available tables: {_TABLES}"
        ) from error


def write_result(result: Any, out: Path) -> None:
    """Write a query's result as .csv or .parquet, without loading it."""
    if os.path.lexists(out):
        raise WouldOverwrite(str(out))
    suffix = out.suffix.lower()
    if suffix not in (".csv", ".parquet"):
        raise InputError(f"--out {out} has no supported suffix; allowed: .csv, .parquet")
    (result.write_csv if suffix == ".csv" else result.write_parquet)(str(out))


def _create_views(database: Any, entries: Sequence[tuple[Path, Entry]], sql: str) -> None:
    """Create the tables whose names occur in a statement."""
    names = set(re.findall(r"\w+", sql.lower()))
    if "runs" in names:
        import pyarrow as pa

        text, texts, number = pa.string(), pa.list_(pa.string()), pa.float64()
        types = {"started": pa.timestamp("us"), "simulated": pa.bool_(), "tags": texts}
        types |= {"notes": texts, "z_over_r_least": number, "z_over_r_most": number}
        schema = pa.schema([(name, types.get(name, text)) for name in RUN_COLUMNS])
        database.register("runs", pa.Table.from_pylist(run_rows(entries), schema=schema))
    for name in names & {"points", "settings"}:
        _register(database, name, _read_tables(entries, name), "no run has a point")
    if "fits" in names:
        tables = []
        for path, entry in entries:
            if entry.kind == "fit":
                # Unreadable fits are skipped; `runs list` shows their problem.
                with suppress(BenchtoolError, LookupError, TypeError, ValueError, AttributeError):
                    tables.append(_fit_rows(path, entry.rig))
        _register(database, "fits", tables, "no entry is a readable fit")
    if "samples" in names:
        files_by_channels: dict[str, list[str]] = {}
        for path, entry in entries:
            file = f"{path}{SAMPLES}"
            if entry.kind in (*SWEEPS, "pitch recording") and os.path.isfile(file):
                files_by_channels.setdefault(entry.channels, []).append(_quote(file))
        # With equal channels, DuckDB reads the columns from the first file only.
        parts = [
            f"SELECT left(filename, -{len(SAMPLES)}) AS run, * EXCLUDE (filename) FROM "
            f"read_parquet([{', '.join(files)}], union_by_name = {not channels}, filename = true)"
            for channels, files in files_by_channels.items()
        ]
        _require(parts, "samples", "no run is closed")
        database.execute(f"CREATE VIEW samples AS {' UNION ALL BY NAME '.join(parts)}")


def _register(database: Any, name: str, tables: Sequence[Any], reason: str) -> None:
    import pyarrow as pa

    _require(tables, name, reason)
    database.register(name, pa.concat_tables(tables, promote_options="permissive"))


def _require(parts: Sequence[Any], name: str, reason: str) -> None:
    if not parts:
        raise InputError(f"the selected runs have no {name}: {reason}; select others")


def _read_tables(entries: Sequence[tuple[Path, Entry]], name: str) -> Sequence[Any]:
    """Return tables of all points or settings; unreadable runs are skipped."""
    runs_by_header: dict[bytes, list[tuple[Path, Entry, list[bytes]]]] = {}
    for path, entry in entries:
        if entry.kind in SWEEPS:
            with suppress(BenchtoolError):
                text = read_file(path / f"{name}.csv", MAX_TABLE_BYTES, follow=False)
                # Without an incomplete last row of a running sweep.
                lines = list(filter(None, text[: text.rfind(b"\n") + 1].splitlines()))
                if len(lines) > 1:
                    runs_by_header.setdefault(lines[0], []).append((path, entry, lines[1:]))
    return [
        table
        for header, runs in runs_by_header.items()
        for start in range(0, len(runs), RUNS_PER_BATCH)
        for table in _parse_rows(header.decode("utf-8", "replace").split(","),
                                 runs[start : start + RUNS_PER_BATCH])
    ]  # fmt: skip


def _parse_rows(names: list[str], runs: Sequence[tuple[Path, Entry, list[bytes]]]) -> list[Any]:
    """Return tables of runs with equal headers, plus path, rig and z/R; skip invalid runs."""
    import pyarrow as pa
    import pyarrow.compute as pc
    from pyarrow import csv

    try:
        types = {name: pa.string() if name in WORDS else pa.float64() for name in names}
        parsed = csv.read_csv(
            pa.BufferReader(b"\n".join(row for *_, rows in runs for row in rows)),
            csv.ReadOptions(column_names=names, use_threads=False),
            csv.ParseOptions(quote_char=False),
            csv.ConvertOptions(column_types=types, null_values=["", "nan"]),
        )
        columns = {name: parsed[name] for name in names}
    except (pa.ArrowException, KeyError):
        half = len(runs) // 2
        return [*_parse_rows(names, runs[:half]), *_parse_rows(names, runs[half:])] if half else []
    index = np.repeat(np.arange(len(runs), dtype=np.int32), [len(rows) for *_, rows in runs])
    extra = {
        "run": pa.DictionaryArray.from_arrays(index, [str(path) for path, *_ in runs]),
        "rig": pa.DictionaryArray.from_arrays(index, [entry.rig for _, entry, _ in runs]),
    }
    if "plate_z_m" in columns:
        radii_m = pa.array([entry.radius_m for _, entry, _ in runs], pa.float64())
        extra["z_over_r"] = pc.divide(columns["plate_z_m"], radii_m.take(pa.array(index)))
    return [pa.table(extra | columns)]


def _fit_rows(path: Path, rig: str) -> Any:
    """Return a table of a fit, one row per method and parameter or derived quantity."""
    import pyarrow as pa

    from benchtool.data.run.entry import read_result

    facts = read_result(path)
    budget = ((facts.get("budget") or {}).get("quantities")) or {}
    rows = [
        {
            "run": str(path), "rig": rig, "model": facts["model"], "basis": facts["basis"],
            "method": method, "parameter": name, "value": value["value"], "sd": value["sd"],
            "low_95": value["interval_95"][0], "high_95": value["interval_95"][1],
            "combined_sd": value.get("combined_sd", (budget.get(name) or {}).get("combined")),
            "unit": value["unit"],
            "derived": part == "derived", "outcome": result["outcome"]["status"],
            "verdict": result["facts"].get("verdict", ""), "chi2_per_dof": result["chi2_per_dof"],
            "points": facts["points"]["used"], "simulated": facts["simulated"],
        }
        for method, result in facts["results"].items()
        for part in ("estimates", "derived")
        for name, value in result[part].items()
    ]  # fmt: skip
    numbers = ("value", "sd", "low_95", "high_95", "combined_sd", "chi2_per_dof")
    types = {"points": pa.int64(), "derived": pa.bool_(), "simulated": pa.bool_()}
    types |= dict.fromkeys(numbers, pa.float64())
    return pa.Table.from_pylist(rows, pa.schema([(n, types.get(n, pa.string())) for n in rows[0]]))


def _quote(text: object) -> str:
    return "'" + str(text).replace("'", "''") + "'"
