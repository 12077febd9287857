"""Entries of the runs folder in worker processes: uploads, column maps, views and downloads.

Every path is derived from a name by `RunsFolder`, which checks it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from benchtool.core.channel import ColumnSource
from benchtool.core.errors import BenchtoolError, FileFormatError, InputError
from benchtool.data.atomic import read_json, replace_text
from benchtool.data.column_map import column_map_to_toml
from benchtool.data.csv_text import read_csv_text
from benchtool.data.formats.formats import detect_format, import_bytes, import_file, is_stand_table
from benchtool.data.propeller_file import load_propeller
from benchtool.data.run import runs_folder
from benchtool.data.run.entry import ANSWER_FILE, FIT_FILE, SWEEPS, Entry, build_entry
from benchtool.data.run.points import export_table
from benchtool.data.run.runs_folder import RunsFolder
from benchtool.data.table import read_table
from benchtool.web.drawing import Content, FigureImage, PageSection, Tiles, Verdict, as_html

if TYPE_CHECKING:
    from benchtool.commands.import_file import ImportInputs
    from benchtool.core.choices import Over
    from benchtool.report.page import Report


def store_upload(root: Path, name: str, data: bytes, date: str, inputs: ImportInputs) -> str:
    """Store a file in the runs folder and return its name there, as `benchtool import`.

    A table is stored unchanged and repaired when it is read; a flight log, or a file with import
    options, is converted to a recording. Nothing is written of an unreadable file.
    """
    from benchtool.data.repairs.import_result import ImportOptions, import_metadata
    from benchtool.data.run.recording_file import write_recording

    folder, options, file_format = RunsFolder(root), inputs.options(), detect_format(data)
    if options == ImportOptions() and (file_format is None or file_format.kind == "table"):
        return folder.relative_name(runs_folder.store_table(folder, name, data, date))
    result = import_bytes(data, runs_folder.upload_name(name), options)
    path = runs_folder.create_table_path(folder, name, date)
    write_recording(path, result.recording, import_metadata(result, options))
    return folder.relative_name(path)


def stand_blocks(path: Path) -> Sequence[Content]:
    """Return the import report of a test-stand table; empty for other tables."""
    from benchtool.report.page import Table

    if not is_stand_table(path):
        return ()
    result = import_file(path)
    tally = result.tally
    counts = f"{tally.kept} of {tally.total} {tally.unit}s accepted, {tally.refused} rejected."
    channels = [(channel.name, result.sources.get(channel.name, ""), channel.unit)
                for channel in result.recording.channels]  # fmt: skip
    blocks: list[Content] = [
        f"Format: {result.format}. {counts}",
        Table("Channels.", ("channel", "column [unit]", "unit"), channels, text_columns=3),
    ]
    if result.findings:
        rows = [
            (item.kind, item.what, item.channel, f"{item.words} (line {item.lines[:40]})"
             if item.lines else item.words)
            for item in result.findings
        ]  # fmt: skip
        header = ("kind", "finding", "channel", "description")
        blocks.append(Table("Findings of the import.", header, rows, text_columns=4))
    return blocks


def store_radius(root: Path, name: str, radius_m: float | None) -> Path:
    """Write a rig file with the rotor radius for a table and return its path."""
    from benchtool.core.rig_file import parse_rig
    from benchtool.data.table_rig import build_radius_rig

    folder = RunsFolder(root)
    table = folder.find_file(name)
    text = build_radius_rig(str(table), radius_m, is_stand=is_stand_table(table))
    if not text:
        raise InputError(f"{name} contains no rotor radius; type one in m")
    parse_rig(text, f"rig of {name}")
    path = folder.new_path(f"{table.stem}.rig.toml")
    replace_text(path, text)
    return path


def store_columns(root: Path, name: str, columns: Mapping[str, ColumnSource]) -> PageSection:
    """Read a table with a column map, store the map next to it and return a summary."""
    from benchtool.report.page import Table

    path = RunsFolder(root).find_file(name)
    recording = read_table(path, columns)
    rows = []
    for channel in recording.channels:
        values = recording.column(channel.name)
        finite = values[np.isfinite(values)]
        low, high = (finite.min(), finite.max()) if finite.size else (np.nan, np.nan)
        rows.append((channel.name, channel.unit, str(finite.size), f"{low:.4g}", f"{high:.4g}"))
    replace_text(runs_folder.column_map_path(path), column_map_to_toml(columns))
    header = ("channel", "unit", "values", "minimum", "maximum")
    repairs = recording.provenance["repairs"]
    table = Table(f"{len(recording)} rows for the fit.", header, rows, text_columns=2)
    texts = [f"Repairs: {repairs}."] if repairs else []
    return PageSection(name, as_html(table, *texts))


FIGURE_WORKER = "figures"  # process that reads runs and draws
PREVIEW_ROWS = 12  # of a table; assumed


def view_entry(root: Path, name: str) -> tuple[PageSection, tuple[str, ...]]:
    """Return the first section of an entry and the titles for `view_part`."""
    folder = RunsFolder(root)
    entry = build_entry(folder, name)
    path = folder.find_path(name)
    if entry.problem:
        has_name = entry.problem.startswith(name)
        raise InputError(entry.problem if has_name else f"{name}: {entry.problem}")
    if entry.kind == "fit":
        return view_fit(root, name), ()
    if entry.kind == "explanation":
        return _view_explanation(path, name), ()
    if entry.kind == "table":
        return _view_table(path, name), _motor_parts(path)
    if entry.summary == "no point yet":
        raise FileFormatError(name, "the sweep has no measured point yet; try again later")
    report = _report(path, entry)
    details = []
    if entry.kind in SWEEPS:
        from benchtool.report.run_facts import simple_facts

        facts = simple_facts(read_json(path / "metadata.json"))
        details.append(PageSection("Rig, device and conditions", as_html(facts)))
    section = PageSection(
        name,
        as_html(report.summary, Tiles(report.highlights), *report.sections[0].blocks),
        simulated=report.simulated,
        command=("report", str(path)),
        details=details,
    )
    extra = _motor_parts(path) if entry.kind == "recording" else ()
    return section, (*(section.title for section in report.sections[1:-1]), *extra)


def view_part(root: Path, name: str, title: str, propeller: str = "") -> PageSection:
    """Return a further section of an entry by title; `propeller` is that of a stand's log."""
    folder = RunsFolder(root)
    if title == MOTOR_PART:
        return _view_motor(folder.find_path(name), propeller)
    report = _report(folder.find_path(name), build_entry(folder, name))
    for section in report.sections:
        if section.title == title:
            return PageSection(title, as_html(*section.blocks), simulated=report.simulated)
    raise InputError(f"{name} has no section {title!r}; open it again")


def view_fit(root: Path, name: str) -> PageSection:
    """Return the result of a stored fit: verdict, tiles, one figure and table; the rest folded."""
    from benchtool.fit.result_file import read_fit
    from benchtool.report.figure import captions
    from benchtool.report.fit.page import FIT, SIMULATED, figure_files, sentence, terminal_blocks
    from benchtool.report.fit.tables import short_table
    from benchtool.report.page import Warnings

    path = RunsFolder(root).find_path(name)
    stored = read_fit(path)
    # Statistical errors are in the details.
    table = short_table(stored.results[0]).select_columns(range(4))
    tiles = {key: value.partition(" (stat")[0] for key, value in FIT.highlights(stored).items()}
    head = (Verdict(sentence(stored, short=True)), Tiles(tiles), Warnings(stored.warnings))
    blocks = [block for block in terminal_blocks(stored) if block != SIMULATED]
    texts = captions("fit")
    figures = [
        FigureImage(file.read_bytes(), texts[key]) for key, file in figure_files(path).items()
    ]
    return PageSection(
        name,
        as_html(*head, *figures[:1], table),
        simulated=stored.simulated,
        command=("report", str(path)),
        details=(
            PageSection("Values, methods and comparisons", as_html(*blocks[:-1])),
            PageSection("More figures", as_html(*figures[1:])),
        ),
    )


MOTOR_PART = "Thrust curve and motor constants"  # section of a test-stand log


def _motor_parts(path: Path) -> tuple[str, ...]:
    """Return the title of the motor section for a log with thrust over pulse width, else ()."""
    from benchtool.data.levels import read_levels

    try:
        names = read_levels(path)[0].names
    except BenchtoolError:
        return ()
    return (MOTOR_PART,) if {"pwm1_us", "thrust_N"} <= set(names) else ()


def _view_motor(path: Path, propeller: str) -> PageSection:
    from benchtool.fit.motor.constants import fit_motor
    from benchtool.report.motor import MOTOR, motor_sentence

    fit = fit_motor([path], propeller=load_propeller(propeller) if propeller else None)
    option = ("--propeller", propeller) if propeller else ()
    blocks = [block for section in MOTOR.sections(fit)[:-1] for block in section.blocks]
    return PageSection(
        MOTOR_PART,
        as_html(motor_sentence(fit), *blocks),
        simulated=fit.simulated,
        command=("motor", str(path), *option),
    )


def export_file(root: Path, name: str, target: str, propeller: str) -> tuple[str, bytes]:
    """Return name and content of the export file for a simulator, an autopilot or firmware."""
    from benchtool.export.targets import file_for
    from benchtool.export.vehicle import build_vehicle

    known = load_propeller(propeller) if propeller else None
    file, text = file_for(build_vehicle(RunsFolder(root).find_path(name), propeller=known), target)
    return file, text.encode("utf-8")


def view_comparison(
    root: Path, names: Sequence[str], over: Over | Literal[""] = "", thrust_N: float | None = None
) -> PageSection:
    """Return a comparison of fits, of sweeps, or over a quantity, ranked at a thrust if any."""
    from benchtool.fit.result_file import read_fit
    from benchtool.report.compare.page import COMPARISON, compare_runs, comparison_sentence
    from benchtool.report.fit.tables import fits_table
    from benchtool.report.report_file import build_report

    paths = [RunsFolder(root).find_path(name) for name in names]
    command: tuple[str, ...] = ("report", *map(str, paths))
    if over:
        comparison = compare_runs(paths, over, thrust_N)
        sections, is_simulated = COMPARISON.sections(comparison), comparison.simulated
        blocks = [block for section in sections for block in section.blocks]
        blocks.insert(0, Verdict(comparison_sentence(comparison)))
        command += ("--over", over)
        command += () if thrust_N is None else ("--at-thrust", f"{thrust_N:g}")
    elif (paths[0] / FIT_FILE).is_file():
        fits = {name: read_fit(path) for name, path in zip(names, paths, strict=True)}
        blocks, command = [fits_table({name: fit.results for name, fit in fits.items()})], ()
        is_simulated = any(fit.simulated for fit in fits.values())
    else:
        report = build_report(paths, "sweep")
        blocks, is_simulated = [*report.sections[0].blocks], report.simulated
    title = f"{len(names)} compared" + (f" over {over}" if over else "")
    return PageSection(title, as_html(*blocks), simulated=is_simulated, command=command)


def _report(path: Path, entry: Entry) -> Report:
    files = (path, *path.glob("*"))
    stamp = max(file.stat().st_mtime_ns for file in files if file.exists())
    return _build_report(path, entry.kind in SWEEPS, stamp)


@lru_cache(maxsize=2)
def _build_report(path: Path, is_sweep: bool, stamp: int) -> Report:
    """Return the report of a run; its figures are drawn on demand."""
    from benchtool.report.report_file import build_report

    del stamp  # part of the cache key: changes with the files
    return build_report([path], "sweep" if is_sweep else "recording")


def _view_explanation(path: Path, name: str) -> PageSection:
    from benchtool.report.answer.figures import WHICH, WHICH_OF_SEVERAL
    from benchtool.report.answer.overlay import overlay_caption
    from benchtool.report.figure import captions

    facts = read_json(path / ANSWER_FILE)
    overlay = overlay_caption(float(facts.get("window_s", 0.0)))
    texts = captions("answer") | {"which": WHICH}
    images = {path / f"{key}.svg": texts[key] for key in ("where", "gap", "parameters", "which")}
    images |= dict.fromkeys(sorted(path.glob("which_*.svg")), WHICH_OF_SEVERAL)
    images |= dict.fromkeys(sorted(path.glob("overlay_*.svg")), overlay)
    figures = [
        FigureImage(file.read_bytes(), caption)
        for file, caption in images.items()
        if file.is_file()
    ]
    rows = {"verdict": str(facts["verdict"]), "model": str(facts["model"])}
    data = facts.get("data", {})
    for purpose, label in (("learn", "training recordings"), ("check", "validation recordings")):
        if purpose in data:
            rows[label] = ", ".join(data[purpose])
    if next_title := facts.get("next_experiment", {}).get("title"):
        rows["next experiment"] = str(next_title)
    return PageSection(
        name,
        as_html(Verdict(facts["sentence"]), *figures[:1], rows),
        simulated=bool(facts["simulated"]),
        command=("report", str(path)),
        details=[PageSection("More figures", as_html(*figures[1:]))],
    )


def _view_table(path: Path, name: str) -> PageSection:
    from benchtool.report.page import Table

    table = read_csv_text(path)
    size = f"{len(table.rows)} rows, {len(table.header)} columns."
    if table.repairs:
        size += f" Repairs: {'; '.join(table.repairs)}."
    caption = f"First {min(PREVIEW_ROWS, len(table.rows))} rows."
    rows = Table(caption, table.header, table.rows[:PREVIEW_ROWS].tolist(), text_columns=0)
    if blocks := stand_blocks(path):
        preview = PageSection("First rows", as_html(rows))
        details = [PageSection("Import", as_html(*blocks)), preview]
        return PageSection(name, as_html(size), details=details)
    return PageSection(name, as_html(size, rows))


def report_bytes(root: Path, names: Sequence[str]) -> bytes:
    """Return the HTML report of an entry or of several sweeps."""
    from benchtool.report.report_file import page_text

    folder = RunsFolder(root)
    return page_text([folder.find_path(name) for name in names]).encode("utf-8")


def table_bytes(root: Path, name: str, table: str, suffix: str) -> bytes:
    """Return one table of a run as a CSV or Parquet file."""
    return export_table(RunsFolder(root).find_path(name), table, suffix)
