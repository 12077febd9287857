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
from benchtool.data.catalogue.entry import Entry
from benchtool.data.catalogue.filters import ChoiceInputs


@dataclass(frozen=True, slots=True, kw_only=True)
class ListInputs(ChoiceInputs):
    """What `benchtool runs list` takes."""

    most: Annotated[int, Ge(1), Input("Show as many, the newest.")] = 40
    paths: Annotated[bool, Input("Print every path alone, one a line, for other commands.")] = False
    rebuild: Annotated[bool, Input("Read every run again, whatever the index says.")] = False


@command_from_inputs(ListInputs)
def list_(inputs: ListInputs) -> None:
    """List runs, fits and recordings."""
    _list(inputs)


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchInputs(ListInputs):
    """What `benchtool runs search` takes."""

    words: Annotated[
        str, Input("Words in name, rig, operator, date, state, tags, notes, ...", argument="WORDS")
    ]


@command_from_inputs(SearchInputs)
def search(inputs: SearchInputs) -> None:
    """Search runs by name, rig, date, tags and notes."""
    _list(inputs)


def _list(inputs: ListInputs) -> None:
    from benchtool.data.catalogue.filters import find_entries

    found = find_entries(inputs, rebuild=inputs.rebuild)
    if inputs.paths:
        print("\n".join(str(path) for path, _ in found))
        return
    if not found:
        print("nothing matches; leave an option out, or see benchtool runs list")
        return
    rows = [
        (str(path), one.kind, one.rig, one.date, one.state, _radii(one), " ".join(one.tags),
         one.problem or one.summary)
        for path, one in found[: inputs.most]
    ]  # fmt: skip
    head = ("path", "kind", "rig or model", "date", "state", "z/R", "tags", "what is in it")
    _print_columns((head, *rows))
    if (left := len(found) - len(rows)) > 0:
        print(f"{left:,} more; choose fewer, or give --most {len(found)}")


def _radii(entry: Entry) -> str:
    return " to ".join(f"{one:.3g}" for one in dict.fromkeys(entry.z_over_r))


def _print_columns(rows: Sequence[tuple[str, ...]]) -> None:
    """Print rows in columns as wide as they need; the last is left as it is."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = (cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        print("  ".join(cells).rstrip())


@dataclass(frozen=True, slots=True, kw_only=True)
class QueryInputs(ChoiceInputs):
    """What `benchtool runs query` takes."""

    sql: Annotated[
        str,
        Input("One SELECT over runs, settings, points, samples, fits.", argument="SELECT"),
    ]
    most: Annotated[int, Ge(1), Input("Show as many rows.")] = 40
    out: Annotated[Path | None, Input("Write every row into this .csv or .parquet file.")] = None


@command_from_inputs(QueryInputs)
def query(inputs: QueryInputs) -> None:
    """Query points, samples and fits with SQL (DuckDB)."""
    from benchtool.data.catalogue.filters import find_entries
    from benchtool.data.catalogue.query import run_query, write_result

    found = find_entries(inputs)
    with run_query(found, inputs.sql) as result:
        if inputs.out is not None:
            write_result(result, inputs.out)
            print(f"written: {inputs.out}")
            return
        columns, rows = tuple(result.columns), result.limit(inputs.most + 1).fetchall()
    shown = [tuple(map(_cell, row)) for row in rows[: inputs.most]]
    _print_columns((columns, *shown))
    if len(rows) > inputs.most:
        print("there are more rows; write them all with --out, or give --most")


def _cell(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else "" if value is None else str(value)


@dataclass(frozen=True, slots=True, kw_only=True)
class TagInputs(Inputs):
    """What `benchtool runs tag` takes."""

    runs: Annotated[tuple[Path, ...], Input("Folders of runs or fits.", argument="RUN")]
    add: Annotated[tuple[str, ...], Input("Tags to give them.", comma_separated=True)] = ()
    remove: Annotated[tuple[str, ...], Input("Tags to take from them.", comma_separated=True)] = ()


@command_from_inputs(TagInputs)
def tag(inputs: TagInputs) -> None:
    """Add, remove or show tags of runs and fits."""
    from benchtool.data.run.labels import check_labels, label

    check_labels(inputs.runs, inputs.add, inputs.remove)
    for path in inputs.runs:
        labels = label(path, inputs.add, inputs.remove)
        print(f"{path}: {', '.join(labels.tags) or 'no tag'}")


@dataclass(frozen=True, slots=True, kw_only=True)
class NoteInputs(Inputs):
    """What `benchtool runs note` takes."""

    run: Annotated[Path, Input("The folder of a run or fit.", argument="RUN")]
    text: Annotated[str, Input("One sentence.", argument="TEXT")]


@command_from_inputs(NoteInputs)
def note(inputs: NoteInputs) -> None:
    """Add a note with date and author to a run or fit."""
    import getpass
    from datetime import datetime

    from benchtool.data.run.labels import label

    text = f"{datetime.now().astimezone():%Y-%m-%d %H:%M} {getpass.getuser()}: {inputs.text}"
    label(inputs.run, note=text)
    print(f"{inputs.run}: {text}")


@dataclass(frozen=True, slots=True, kw_only=True)
class ShowInputs(Inputs):
    """What `benchtool runs show` and `compare` take."""

    runs: Annotated[tuple[Path, ...], Input("Folders of runs or fits.", argument="RUN")]


@command_from_inputs(ShowInputs)
def show(inputs: ShowInputs) -> None:
    """Show the catalogue entries of runs and fits."""
    for facts in [_facts(path) for path in inputs.runs]:
        for name, value in facts.items():
            print(f"{name:<12} {value}".rstrip())


@command_from_inputs(ShowInputs)
def compare(inputs: ShowInputs) -> None:
    """Compare runs: metadata, and T_IGE/T_OGE by z/R."""
    from benchtool.core.plural import pluralize
    from benchtool.data.run.settings import ratios_by_distance

    if len(inputs.runs) < 2:
        raise InputError(f"one run is named, {inputs.runs[0]}; name two or more to compare")
    facts = [_facts(path) for path in inputs.runs]
    rows = [(name, *(one.get(name, "") for one in facts)) for name in facts[0] if name != "notes"]
    _print_columns(rows)
    ratios = ratios_by_distance(inputs.runs)
    if ratios:
        print(f"T_IGE/T_OGE at equal squared speed, mean over {pluralize(len(ratios), 'distance')}")
        shown = [
            (f"z/R {z:.3g}", *("" if one is None else f"{one:.4f}" for one in row))
            for z, row in ratios
        ]
        _print_columns([("", *map(str, inputs.runs)), *shown])


def _facts(path: Path) -> dict[str, str]:
    from benchtool.data.run.entry import build_entry
    from benchtool.data.run.runs_folder import RunsFolder

    real = path.resolve()
    one = build_entry(RunsFolder(real.parent), real.name)
    return {
        "run": str(path), "kind": one.kind, "rig": one.rig, "propeller": one.propeller,
        "operator": one.operator, "date": one.date,
        "state": one.state + (", simulated" if one.simulated else ""), "z/R": _radii(one),
        "tags": ", ".join(one.tags), "notes": "; ".join(one.notes), "holds": one.summary,
        **({"problem": one.problem} if one.problem else {}),
    }  # fmt: skip


@command_from_inputs(ShowInputs)
def verify(inputs: ShowInputs) -> None:
    """Verify the file hashes of runs; exit code 2 on a mismatch."""
    from benchtool.data.run.entry import verify_run

    wrong = 0
    for path in inputs.runs:
        problems = verify_run(path)
        wrong += bool(problems)
        print(f"{path}: {'; '.join(problems) or 'as stated'}", flush=True)
    if wrong:
        raise InputError(f"{wrong} of {len(inputs.runs)} are not as stated; restore from a copy")


@dataclass(frozen=True, slots=True, kw_only=True)
class RunExportInputs(Inputs):
    """What `benchtool runs export` takes."""

    run: Annotated[Path, Input("The run folder.", argument="RUN")]
    out: Annotated[Path, Input("The file, which ends in .mcap, .parquet or .csv.", argument="FILE")]
    table: Annotated[Literal["samples", "points", "settings"], Input("What of the run.")] = (
        "samples"
    )


@command_from_inputs(RunExportInputs)
def export(inputs: RunExportInputs) -> None:
    """Export samples, points or settings of a run as MCAP, Parquet or CSV."""
    from benchtool.core.errors import WouldOverwrite
    from benchtool.data.atomic import replace_bytes
    from benchtool.data.run.run import Run
    from benchtool.data.run.settings import export_table

    if inputs.out.exists():
        raise WouldOverwrite(str(inputs.out))
    run = Run.open(inputs.run)
    replace_bytes(inputs.out, export_table(run.path, inputs.table, inputs.out.suffix.lower()))
    print(f"written: {inputs.out}")


@dataclass(frozen=True, slots=True, kw_only=True)
class MergeInputs(Inputs):
    """What `benchtool runs merge` takes."""

    runs: Annotated[tuple[Path, ...], Input("Runs of one rig and propeller.", argument="RUN")]
    out: Annotated[Path, Input("The new run folder.", alias="-o")]


@command_from_inputs(MergeInputs)
def merge(inputs: MergeInputs) -> None:
    """Merge runs of one rig and propeller into a new run folder."""
    from benchtool.core.plural import pluralize
    from benchtool.data.run.merge import merge_runs
    from benchtool.data.run.read import parts_of

    run = merge_runs(inputs.runs, inputs.out)
    print(f"written: {inputs.out}, of {pluralize(len(parts_of(run.path)), 'run')}")


@dataclass(frozen=True, slots=True, kw_only=True)
class CloseInputs(Inputs):
    """What `benchtool runs close` takes."""

    runs: Annotated[tuple[Path, ...], Input("Run folders.", argument="RUN")]


@command_from_inputs(CloseInputs)
def close(inputs: CloseInputs) -> None:
    """Repair interrupted runs and write their tables; can be repeated."""
    from benchtool.acquire.resume import close_run
    from benchtool.data.run.run import Run

    for run in [Run.open(path) for path in inputs.runs]:
        written = close_run(run)
        facts = run.metadata
        reason = f" ({facts['reason']})" if facts.get("reason") else ""
        done = "closed" if written else "it was closed already"
        print(f"{run.path}: {done}; {facts.get('state', '')}{reason}")
