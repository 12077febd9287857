"""Commands `benchtool runs ...`: list, label, query and repair runs on disk."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from annotated_types import Ge

from benchtool.commands.input_commands import command_from_inputs
from benchtool.core.errors import InputError
from benchtool.core.inputs import Input, Inputs
from benchtool.data.catalogue.entry import ChoiceInputs, Entry


@dataclass(frozen=True, slots=True, kw_only=True)
class ListInputs(ChoiceInputs):
    """Options of `benchtool runs list`."""

    most: Annotated[int, Ge(1), Input("Maximum number of entries, newest first.")] = 40
    paths: Annotated[bool, Input("Print paths only, one per line.")] = False
    rebuild: Annotated[bool, Input("Rebuild the index.")] = False


@command_from_inputs(ListInputs)
def list_(inputs: ListInputs) -> None:
    """List runs, fits and recordings."""
    _list(inputs)


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchInputs(ListInputs):
    """Options of `benchtool runs search`."""

    words: Annotated[
        str, Input("Words in name, rig, operator, date, state, tags, notes.", argument="WORDS")
    ]


@command_from_inputs(SearchInputs)
def search(inputs: SearchInputs) -> None:
    """Search runs by name, rig, date, tags and notes."""
    _list(inputs)


def _list(inputs: ListInputs) -> None:
    from benchtool.data.catalogue.index import find_entries

    entries = find_entries(inputs, rebuild=inputs.rebuild)
    if inputs.paths:
        print("\n".join(str(path) for path, _ in entries))
        return
    if not entries:
        print("no match; remove an option, or use benchtool runs list")
        return
    rows = [
        (str(path), entry.kind, entry.rig, entry.date, entry.state, _radii(entry),
         " ".join(entry.tags), entry.problem or entry.summary)
        for path, entry in entries[: inputs.most]
    ]  # fmt: skip
    head = ("path", "kind", "rig or model", "date", "state", "z/R", "tags", "content")
    _print_columns((head, *rows))
    if (hidden := len(entries) - len(rows)) > 0:
        print(f"{hidden:,} more; add a filter, or --most {len(entries)}")


def _radii(entry: Entry) -> str:
    return " to ".join(f"{ratio:.3g}" for ratio in dict.fromkeys(entry.z_over_r))


def _print_columns(rows: Sequence[tuple[str, ...]]) -> None:
    """Print rows in aligned columns."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = (cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        print("  ".join(cells).rstrip())


@dataclass(frozen=True, slots=True, kw_only=True)
class QueryInputs(ChoiceInputs):
    """Options of `benchtool runs query`."""

    sql: Annotated[
        str, Input("SQL SELECT over runs, settings, points, samples, fits.", argument="SELECT")
    ]
    most: Annotated[int, Ge(1), Input("Maximum number of rows.")] = 40
    out: Annotated[Path | None, Input("Write all rows to this .csv or .parquet file.")] = None


@command_from_inputs(QueryInputs)
def query(inputs: QueryInputs) -> None:
    """Query points, samples and fits with SQL (DuckDB)."""
    from benchtool.data.catalogue.index import find_entries
    from benchtool.data.catalogue.query import run_query, write_result

    entries = find_entries(inputs)
    with run_query(entries, inputs.sql) as result:
        if inputs.out is not None:
            write_result(result, inputs.out)
            print(f"written: {inputs.out}")
            return
        columns, rows = tuple(result.columns), result.limit(inputs.most + 1).fetchall()
    cells = [tuple(map(_format_cell, row)) for row in rows[: inputs.most]]
    _print_columns((columns, *cells))
    if len(rows) > inputs.most:
        print("there are more rows; write all with --out, or use --most")


def _format_cell(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else "" if value is None else str(value)


@dataclass(frozen=True, slots=True, kw_only=True)
class TagInputs(Inputs):
    """Options of `benchtool runs tag`."""

    runs: Annotated[tuple[Path, ...], Input("Run or fit folders.", argument="RUN")]
    add: Annotated[tuple[str, ...], Input("Tags to add.", comma_separated=True)] = ()
    remove: Annotated[tuple[str, ...], Input("Tags to remove.", comma_separated=True)] = ()


@command_from_inputs(TagInputs)
def tag(inputs: TagInputs) -> None:
    """Add, remove or show tags of runs and fits."""
    from benchtool.data.run.entry import check_labels, update_labels

    check_labels(inputs.runs, inputs.add, inputs.remove)
    for path in inputs.runs:
        labels = update_labels(path, inputs.add, inputs.remove)
        print(f"{path}: {', '.join(labels.tags) or 'no tag'}")


@dataclass(frozen=True, slots=True, kw_only=True)
class NoteInputs(Inputs):
    """Options of `benchtool runs note`."""

    run: Annotated[Path, Input("Run or fit folder.", argument="RUN")]
    text: Annotated[str, Input("One sentence.", argument="TEXT")]


@command_from_inputs(NoteInputs)
def note(inputs: NoteInputs) -> None:
    """Add a note with date and author to a run or fit."""
    import getpass
    from datetime import datetime

    from benchtool.data.run.entry import update_labels

    text = f"{datetime.now().astimezone():%Y-%m-%d %H:%M} {getpass.getuser()}: {inputs.text}"
    update_labels(inputs.run, note=text)
    print(f"{inputs.run}: {text}")


@dataclass(frozen=True, slots=True, kw_only=True)
class ShowInputs(Inputs):
    """Options of `benchtool runs show` and `compare`."""

    runs: Annotated[tuple[Path, ...], Input("Run or fit folders.", argument="RUN")]


@command_from_inputs(ShowInputs)
def show(inputs: ShowInputs) -> None:
    """Show the catalogue entries of runs and fits."""
    for entry in [_describe_entry(path) for path in inputs.runs]:
        for name, value in entry.items():
            print(f"{name:<12} {value}".rstrip())


@command_from_inputs(ShowInputs)
def compare(inputs: ShowInputs) -> None:
    """Compare runs: metadata, and T_IGE/T_OGE by z/R."""
    from benchtool.core.text import pluralize
    from benchtool.data.run.points import ratios_by_distance

    if len(inputs.runs) < 2:
        raise InputError(f"only one run, {inputs.runs[0]}; give two or more to compare")
    entries = [_describe_entry(path) for path in inputs.runs]
    names = [name for name in entries[0] if name != "notes"]
    rows = [(name, *(entry.get(name, "") for entry in entries)) for name in names]
    _print_columns(rows)
    ratios = ratios_by_distance(inputs.runs)
    if ratios:
        print(f"T_IGE/T_OGE at equal squared speed, mean over {pluralize(len(ratios), 'distance')}")
        cells = [
            (f"z/R {z:.3g}", *("" if ratio is None else f"{ratio:.4f}" for ratio in row))
            for z, row in ratios
        ]
        _print_columns([("", *map(str, inputs.runs)), *cells])


def _describe_entry(path: Path) -> dict[str, str]:
    from benchtool.data.run.entry import build_entry
    from benchtool.data.run.runs_folder import RunsFolder

    real = path.resolve()
    entry = build_entry(RunsFolder(real.parent), real.name)
    return {
        "run": str(path), "kind": entry.kind, "rig": entry.rig, "propeller": entry.propeller,
        "operator": entry.operator, "date": entry.date,
        "state": entry.state + (", simulated" if entry.simulated else ""), "z/R": _radii(entry),
        "tags": ", ".join(entry.tags), "notes": "; ".join(entry.notes), "content": entry.summary,
        **({"problem": entry.problem} if entry.problem else {}),
    }  # fmt: skip


@command_from_inputs(ShowInputs)
def verify(inputs: ShowInputs) -> None:
    """Verify the file hashes of runs; exit code 2 on a mismatch."""
    from benchtool.data.run.entry import verify_run

    n_failed = 0
    for path in inputs.runs:
        problems = verify_run(path)
        n_failed += bool(problems)
        print(f"{path}: {'; '.join(problems) or 'hashes match'}", flush=True)
    if n_failed:
        raise InputError(
            f"hashes of {n_failed} of {len(inputs.runs)} runs do not match; restore from a copy"
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class RunExportInputs(Inputs):
    """Options of `benchtool runs export`."""

    run: Annotated[Path, Input("Run folder.", argument="RUN")]
    out: Annotated[Path, Input("New file: .mcap, .parquet or .csv.", argument="FILE")]
    table: Annotated[Literal["samples", "points", "settings"], Input("Table to export.")] = (
        "samples"
    )


@command_from_inputs(RunExportInputs)
def export(inputs: RunExportInputs) -> None:
    """Export samples, points or settings of a run as MCAP, Parquet or CSV."""
    from benchtool.core.errors import WouldOverwrite
    from benchtool.data.atomic import replace_bytes
    from benchtool.data.run.points import export_table
    from benchtool.data.run.run import Run

    if inputs.out.exists():
        raise WouldOverwrite(str(inputs.out))
    run = Run.open(inputs.run)
    replace_bytes(inputs.out, export_table(run.path, inputs.table, inputs.out.suffix.lower()))
    print(f"written: {inputs.out}")


@dataclass(frozen=True, slots=True, kw_only=True)
class MergeInputs(Inputs):
    """Options of `benchtool runs merge`."""

    runs: Annotated[tuple[Path, ...], Input("Runs of one rig and propeller.", argument="RUN")]
    out: Annotated[Path, Input("New run folder.", alias="-o")]


@command_from_inputs(MergeInputs)
def merge(inputs: MergeInputs) -> None:
    """Merge runs of one rig and propeller into a new run folder."""
    from benchtool.core.text import pluralize
    from benchtool.data.run.merge import merge_runs
    from benchtool.data.run.read import find_parts

    run = merge_runs(inputs.runs, inputs.out)
    print(f"written: {inputs.out}, from {pluralize(len(find_parts(run.path)), 'run')}")


@dataclass(frozen=True, slots=True, kw_only=True)
class CloseInputs(Inputs):
    """Options of `benchtool runs close`."""

    runs: Annotated[tuple[Path, ...], Input("Run folders.", argument="RUN")]


@command_from_inputs(CloseInputs)
def close(inputs: CloseInputs) -> None:
    """Repair interrupted runs and write their tables; can be repeated."""
    from benchtool.acquire.resume import close_run
    from benchtool.data.run.run import Run

    for run in [Run.open(path) for path in inputs.runs]:
        written = close_run(run)
        metadata = run.metadata
        reason = f" ({metadata['reason']})" if metadata.get("reason") else ""
        action = "closed" if written else "already closed"
        print(f"{run.path}: {action}; {metadata.get('state', '')}{reason}")
