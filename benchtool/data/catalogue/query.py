"""Runs chosen from a catalogue, and SQL over their tables by DuckDB, which reads what it needs."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchtool.core.counted import counted
from benchtool.core.errors import InputError, WouldOverwrite
from benchtool.core.inputs import make
from benchtool.data.catalogue.choice import ChoiceInputs, find_entries
from benchtool.data.catalogue.entry import SWEEPS, Entry
from benchtool.data.catalogue.extra import load_extra
from benchtool.data.catalogue.index import index_folder
from benchtool.data.catalogue.tables import TABLES, row_numbers

if TYPE_CHECKING:
    import pandas as pd

_NAMED = "runs, settings, points, samples and fits"

SAMPLES = "/samples.parquet"

MEMORY_MB = 600
"""What DuckDB may hold, so that a query stays below 1 GiB with all that is loaded; a choice."""


RUN_COLUMNS = (
    "run", "kind", "rig", "propeller", "operator", "started", "state", "simulated",
    "z_over_r_least", "z_over_r_most", "tags", "notes", "summary", "problem",
)  # fmt: skip
"""Columns of the table `runs`."""


@dataclass(frozen=True, slots=True, eq=False)
class ChosenRuns:
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
        return f"{counted(len(self), 'run')} and results chosen"

    def table(self) -> pd.DataFrame:
        """Return a row for each: run, kind, rig, propeller, operator, UTC date, distances, tags."""
        from benchtool.data.columns import frame_of_rows

        return frame_of_rows(run_rows(self.found))

    def query(self, sql: str) -> pd.DataFrame:
        """Return what a SELECT says of the tables runs, settings, points, samples and fits.

        Raises:
            InputError: DuckDB is not installed, or it refuses the statement.
        """
        with queried(self.found, sql) as result:
            table: pd.DataFrame = result.df()
            return table


def runs(*folders: str | Path, **by: Any) -> ChosenRuns:
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
    return ChosenRuns(find_entries(make(ChoiceInputs, given | by)))


def run_rows(found: Sequence[tuple[Path, Entry]]) -> list[dict[str, Any]]:
    """Return what the table `runs` holds of each entry."""
    return [
        {
            "run": str(path), "kind": one.kind, "rig": one.rig, "propeller": one.propeller,
            "operator": one.operator, "started": _utc(one), "state": one.state,
            "simulated": one.simulated, "z_over_r_least": one.z_over_r[0] if one.z_over_r else None,
            "z_over_r_most": one.z_over_r[1] if one.z_over_r else None, "tags": list(one.tags),
            "notes": list(one.notes), "summary": one.summary, "problem": one.problem,
        }
        for path, one in found
    ]  # fmt: skip


def _utc(entry: Entry) -> datetime | None:
    return entry.started and entry.started.astimezone(UTC).replace(tzinfo=None)


@contextmanager
def queried(found: Sequence[tuple[Path, Entry]], sql: str) -> Iterator[Any]:
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
            if found:
                temporary = index_folder(_roots(found)[0][0]) / "spill"
                base.execute(f"SET temp_directory = {_quoted(temporary)}")
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
    for name in words & {*TABLES}:
        parts = [
            part for root, entries in _roots(found) if (part := _stored(base, name, root, entries))
        ]
        _view(base, name, parts, "they hold no point" if name != "fits" else "none of them is one")
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
        _view(base, "samples", parts, "none of them is closed")


def _stored(base: Any, name: str, root: Path, entries: Sequence[Entry]) -> str:
    """Return the SELECT of the stored rows of some entries of one folder."""
    numbers, places = row_numbers(root, entries, TABLES[name])
    files = [file for place in places if (file := place / f"{name}.parquet").is_file()]
    if not files:
        return ""
    own = f"numbers_{TABLES[name][0]}_{index_folder(root).name}"
    base.execute(
        f"CREATE TEMP TABLE IF NOT EXISTS {own} AS SELECT unnest(?::BIGINT[]) AS run_number",
        [numbers],
    )
    listed = ", ".join(_quoted(file) for file in files)
    before = _quoted(str(root / "_")[:-1])
    return (
        f"SELECT {before} || run AS run, * EXCLUDE (run, run_number) "
        f"FROM read_parquet([{listed}], union_by_name = true) SEMI JOIN {own} USING (run_number)"
    )


def _view(base: Any, name: str, parts: Sequence[str], why: str) -> None:
    if not parts:
        raise InputError(f"the chosen runs have no {name}: {why}; choose others")
    base.execute(f"CREATE VIEW {name} AS {' UNION ALL BY NAME '.join(parts)}")


def _roots(found: Sequence[tuple[Path, Entry]]) -> list[tuple[Path, list[Entry]]]:
    """Return the entries of each folder of runs."""
    roots: dict[Path, list[Entry]] = {}
    for path, entry in found:
        root = Path(str(path)[: -len(entry.name) - 1] or ".")
        roots.setdefault(root, []).append(entry)
    return list(roots.items())


def _quoted(text: object) -> str:
    return "'" + str(text).replace("'", "''") + "'"
