"""Runs chosen from a catalogue, and SQL over their tables by DuckDB, which reads what it needs."""

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
from benchtool.core.plural import pluralize
from benchtool.core.table_bounds import MAX_TABLE_BYTES
from benchtool.core.user_file import read_file
from benchtool.data.catalogue.entry import SWEEPS, Entry
from benchtool.data.catalogue.filters import ChoiceInputs, find_entries
from benchtool.data.catalogue.optional_dependency import load_extra
from benchtool.data.columns import WORDS
from benchtool.data.run.state import state_folder

if TYPE_CHECKING:
    import pandas as pd

_NAMED = "runs, settings, points, samples and fits"

SAMPLES = "/samples.parquet"

RUNS_AT_ONCE = 2000  # texts of so many runs are in memory at once, 50 MB; assumed
MEMORY_MB = 600  # of DuckDB, so that a query stays below 1 GiB; assumed


RUN_COLUMNS = (
    "run", "kind", "rig", "propeller", "operator", "started", "state", "simulated",
    "z_over_r_least", "z_over_r_most", "tags", "notes", "summary", "problem",
)  # fmt: skip
"""Columns of the table `runs`."""


@dataclass(frozen=True, slots=True, eq=False)
class RunSelection:
    """Hold what was chosen from folders of runs; iterating gives paths, for `bt.fit` and others.

    Attributes:
        found: each path with its entry, the newest first in each folder.
    """

    found: Sequence[tuple[Path, Entry]]

    def __len__(self) -> int:
        return len(self.found)

    def __iter__(self) -> Iterator[Path]:
        return (path for path, _ in self.found)

    def __str__(self) -> str:
        return f"{pluralize(len(self), 'run')} and results chosen"

    def table(self) -> pd.DataFrame:
        """Return a row for each: run, kind, rig, propeller, operator, UTC date, distances, tags."""
        from benchtool.data.columns import frame_of_rows

        return frame_of_rows(run_rows(self.found))

    def query(self, sql: str) -> pd.DataFrame:
        """Return what a SELECT says of the tables runs, settings, points, samples and fits.

        Raises:
            InputError: DuckDB is not installed, or it refuses the statement.
        """
        with run_query(self.found, sql) as result:
            table: pd.DataFrame = result.df()
            return table


def runs(*folders: str | Path, **by: Any) -> RunSelection:
    """Choose runs, fits and recordings of folders by their catalogue, as `benchtool runs list`.

    Iterating gives paths, for `read` and `fit`; `.table()` a data frame; `.query(sql)` what SQL
    says of the points, settings and samples of all of them (DuckDB).

    Args:
        folders: of runs; ``runs`` when left out.
        by: options of the command by name: ``rig="pquad"``, ``z_over_r=(0.5, 1)``, ``tag="lab"``.

    Raises:
        InputError: a folder that is not there, or an option that nobody knows.
    """
    given: dict[str, Any] = {"folder": tuple(Path(folder) for folder in folders)} if folders else {}
    return RunSelection(find_entries(build_inputs(ChoiceInputs, given | by)))


def run_rows(found: Sequence[tuple[Path, Entry]]) -> list[dict[str, Any]]:
    """Return what the table `runs` holds of each entry."""
    return [
        {
            "run": str(path), "kind": one.kind, "rig": one.rig, "propeller": one.propeller,
            "operator": one.operator, "state": one.state, "simulated": one.simulated,
            "started": one.started and one.started.astimezone(UTC).replace(tzinfo=None),
            "z_over_r_least": one.z_over_r[0] if one.z_over_r else None,
            "z_over_r_most": one.z_over_r[1] if one.z_over_r else None, "tags": list(one.tags),
            "notes": list(one.notes), "summary": one.summary, "problem": one.problem,
        }
        for path, one in found
    ]  # fmt: skip


@contextmanager
def run_query(found: Sequence[tuple[Path, Entry]], sql: str) -> Iterator[Any]:
    """Give DuckDB's relation of one SELECT over the tables of some entries.

    Raises:
        InputError: DuckDB is not installed, the statement is no single SELECT, or DuckDB refuses
            it.
    """
    duckdb = load_extra("duckdb", "catalogue", "a query over runs")
    try:
        statements = duckdb.extract_statements(sql)
        if len(statements) != 1 or statements[0].type != duckdb.StatementType.SELECT:
            raise InputError("a query is one SELECT, which changes no file; give one")
        with duckdb.connect() as base:
            base.execute(f"SET memory_limit = '{MEMORY_MB}MB'")
            base.execute("SET preserve_insertion_order = false")
            spill = state_folder() / "catalogue" / "spill"
            base.execute(f"SET temp_directory = {_quoted(spill)}")
            _make_views(base, found, sql)
            yield base.sql(sql)
    except duckdb.Error as error:
        reason = " ".join(str(error).split())[:300]
        known = f"the tables are {_NAMED}"
        raise InputError(f"DuckDB refuses the query: {reason}; {known}") from error


def write_result(result: Any, out: Path) -> None:
    """Write a query's result as .csv or .parquet, without loading it.

    Raises:
        WouldOverwrite: the file exists.
        InputError: a name that ends otherwise.
    """
    if os.path.lexists(out):
        raise WouldOverwrite(str(out))
    if out.suffix.lower() not in (".csv", ".parquet"):
        raise InputError(f"--out {out} ends in neither .csv nor .parquet; end it so")
    (result.write_csv if out.suffix.lower() == ".csv" else result.write_parquet)(str(out))


def _make_views(base: Any, found: Sequence[tuple[Path, Entry]], sql: str) -> None:
    """Make the tables that a statement names."""
    words = set(re.findall(r"\w+", sql.lower()))
    if "runs" in words:
        import pyarrow as pa

        text, texts, number = pa.string(), pa.list_(pa.string()), pa.float64()
        other = {"started": pa.timestamp("us"), "simulated": pa.bool_(), "tags": texts}
        other |= {"notes": texts, "z_over_r_least": number, "z_over_r_most": number}
        schema = pa.schema([(name, other.get(name, text)) for name in RUN_COLUMNS])
        base.register("runs", pa.Table.from_pylist(run_rows(found), schema=schema))
    for name in words & {"points", "settings"}:
        _register(base, name, _run_rows(found, name), "they hold no point")
    if "fits" in words:
        tables = []
        for path, one in found:
            if one.kind == "fit":
                # The list shows one that cannot be read with its problem.
                with suppress(BenchtoolError, LookupError, TypeError, ValueError, AttributeError):
                    tables.append(_fit_rows(path, one.rig))
        _register(base, "fits", tables, "none of them is one")
    if "samples" in words:
        forms: dict[str, list[str]] = {}
        for path, one in found:
            if one.kind in (*SWEEPS, "pitch recording") and os.path.isfile(
                file := f"{path}{SAMPLES}"
            ):
                forms.setdefault(one.channels, []).append(_quoted(file))
        # Files of one form need not all be opened to find the columns of the table.
        parts = [
            f"SELECT left(filename, -{len(SAMPLES)}) AS run, * EXCLUDE (filename) "
            f"FROM read_parquet([{', '.join(files)}], union_by_name = {not form}, filename = true)"
            for form, files in forms.items()
        ]
        _require(parts, "samples", "none of them is closed")
        base.execute(f"CREATE VIEW samples AS {' UNION ALL BY NAME '.join(parts)}")


def _register(base: Any, name: str, tables: Sequence[Any], why: str) -> None:
    import pyarrow as pa

    _require(tables, name, why)
    base.register(name, pa.concat_tables(tables, promote_options="permissive"))


def _require(parts: Sequence[Any], name: str, why: str) -> None:
    if not parts:
        raise InputError(f"the chosen runs have no {name}: {why}; choose others")


def _run_rows(found: Sequence[tuple[Path, Entry]], name: str) -> Sequence[Any]:
    """Return tables of all points or settings; a run that cannot be read has no rows."""
    forms: dict[bytes, list[tuple[Path, Entry, list[bytes]]]] = {}
    for path, one in found:
        if one.kind in SWEEPS:
            with suppress(BenchtoolError):
                text = read_file(path / f"{name}.csv", MAX_TABLE_BYTES, follow=False)
                # What stands behind the last line end is a row that is being written.
                lines = list(filter(None, text[: text.rfind(b"\n") + 1].splitlines()))
                if len(lines) > 1:
                    forms.setdefault(lines[0], []).append((path, one, lines[1:]))
    return [
        table
        for header, runs in forms.items()
        for start in range(0, len(runs), RUNS_AT_ONCE)
        for table in _parsed(header.decode("utf-8", "replace").split(","),
                             runs[start : start + RUNS_AT_ONCE])
    ]  # fmt: skip


def _parsed(names: list[str], runs: Sequence[tuple[Path, Entry, list[bytes]]]) -> list[Any]:
    """Return the rows of runs with one header, each with its path, rig and z/R."""
    import pyarrow as pa
    import pyarrow.compute as pc
    from pyarrow import csv

    try:
        read = csv.read_csv(
            pa.BufferReader(b"\n".join(row for *_, rows in runs for row in rows)),
            csv.ReadOptions(column_names=names, use_threads=False),
            csv.ParseOptions(quote_char=False),
            csv.ConvertOptions(
                column_types={one: pa.string() if one in WORDS else pa.float64() for one in names},
                null_values=["", "nan"],
            ),
        )
        columns = {name: read[name] for name in names}
    except (pa.ArrowException, KeyError):
        half = len(runs) // 2
        return [*_parsed(names, runs[:half]), *_parsed(names, runs[half:])] if half else []
    own = np.repeat(np.arange(len(runs), dtype=np.int32), [len(rows) for *_, rows in runs])
    facts = {
        "run": pa.DictionaryArray.from_arrays(own, [str(path) for path, *_ in runs]),
        "rig": pa.DictionaryArray.from_arrays(own, [one.rig for _, one, _ in runs]),
    }
    if "plate_z_m" in columns:
        radius_m = pa.array([one.radius_m for _, one, _ in runs], pa.float64()).take(pa.array(own))
        facts["z_over_r"] = pc.divide(columns["plate_z_m"], radius_m)
    return [pa.table(facts | columns)]


def _fit_rows(path: Path, rig: str) -> Any:
    """Return a table with a row for each parameter and derived quantity of a fit by each method."""
    import pyarrow as pa

    from benchtool.data.run.entry import read_result

    facts = read_result(path)
    budget = ((facts.get("budget") or {}).get("quantities")) or {}
    rows = [
        {
            "run": str(path), "rig": rig, "model": facts["model"], "basis": facts["basis"],
            "method": method, "parameter": name, "value": one["value"], "sd": one["sd"],
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
    other = {"points": pa.int64(), "derived": pa.bool_(), "simulated": pa.bool_()}
    other |= dict.fromkeys(numbers, pa.float64())
    return pa.Table.from_pylist(rows, pa.schema([(n, other.get(n, pa.string())) for n in rows[0]]))


def _quoted(text: object) -> str:
    return "'" + str(text).replace("'", "''") + "'"
