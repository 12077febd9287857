"""What the page shows and offers of one thing in the runs folder, for a process of its own.

Everything comes from the functions that the reports and the command line are made with. Every
path comes from a name through `RunsFolder`, here as well as in the page.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from benchtool.core.errors import BenchtoolError, FileFormatError, InputError
from benchtool.data.atomic import read_json
from benchtool.data.csv_text import read_csv_text
from benchtool.data.run.entry import ANSWER_FILE, SWEEPS, Entry, build_entry
from benchtool.data.run.runs_folder import RunsFolder
from benchtool.data.run.settings import export_table
from benchtool.web.jobs import PageSection
from benchtool.web.tabs.fit.work import view_fit
from benchtool.web.uploads import stand_blocks

if TYPE_CHECKING:
    from benchtool.report.compare.runs import Over
    from benchtool.report.page import Block, Report

HEAD_ROWS = 12  # Rows of a table that are shown; a choice


def view_entry(root: Path, name: str) -> tuple[PageSection, tuple[str, ...]]:
    """Return what is shown of an entry at first, and the names of what `view_part` adds.

    Raises:
        BenchtoolError: it cannot be read, for the reason in the list.
    """
    folder = RunsFolder(root)
    entry = build_entry(folder, name)
    path = folder.path_of(name)
    if entry.problem:
        known = entry.problem.startswith(name)
        raise InputError(entry.problem if known else f"{name}: {entry.problem}")
    if entry.kind == "fit":
        return view_fit(root, name), ()
    if entry.kind == "explanation":
        return _answer(path, name), ()
    if entry.kind == "table":
        return _table(path, name), _motor_parts(path)
    if entry.summary == "no point yet":
        raise FileFormatError(name, "the sweep has measured no point yet; look again later")
    from benchtool.report.page import FactTable, Paragraph
    from benchtool.web.drawing import blocks_html

    report = _report(path, entry)
    blocks: list[Block] = [Paragraph(report.summary)]
    if entry.kind in SWEEPS:
        from benchtool.report.run_facts import simple_facts

        blocks.append(FactTable(simple_facts(read_json(path / "metadata.json"))))
    section = PageSection(
        title=name,
        html=blocks_html([*blocks, *report.sections[0].blocks]),
        simulated=report.simulated,
        command=("report", str(path)),
    )
    more = _motor_parts(path) if entry.kind == "recording" else ()
    return section, (*(part.title for part in report.sections[1:-1]), *more)


def view_part(root: Path, name: str, part: str) -> PageSection:
    """Return one more section of an entry, by its title."""
    from benchtool.web.drawing import blocks_html

    folder = RunsFolder(root)
    if part == MOTOR_PART:
        return _motor(folder.path_of(name))
    report = _report(folder.path_of(name), build_entry(folder, name))
    for section in report.sections:
        if section.title == part:
            return PageSection(
                title=part, html=blocks_html(section.blocks), simulated=report.simulated
            )
    raise InputError(f"{name} has no part {part!r}; open it again")


MOTOR_PART = "Thrust curve and motor constants"  # What is shown of a stand's log beside its numbers


def _motor_parts(path: Path) -> tuple[str, ...]:
    """Return the part for motor constants where a log of a stand has thrust over pulses."""
    from benchtool.data.levels import read_levels

    try:
        names = read_levels(path)[0].names
    except BenchtoolError:
        return ()
    return (MOTOR_PART,) if {"pwm1_us", "thrust_N"} <= set(names) else ()


def _motor(path: Path) -> PageSection:
    from benchtool.fit.motor.constants import fit_motor
    from benchtool.report.motor.page import MOTOR, motor_sentence
    from benchtool.report.page import Paragraph
    from benchtool.web.drawing import blocks_html

    fit = fit_motor([path])
    blocks = [block for part in MOTOR.sections(fit)[:-1] for block in part.blocks]
    return PageSection(
        title=MOTOR_PART,
        html=blocks_html([Paragraph(motor_sentence(fit)), *blocks]),
        simulated=fit.simulated,
        command=("motor", str(path)),
    )


def export_file(root: Path, name: str, to: str) -> tuple[str, bytes]:
    """Return name and content of an entry's file for a simulator, an autopilot or firmware.

    Raises:
        InputError: it was rejected by its own data, or a log does not say what it needs.
    """
    from benchtool.export.targets import file_for
    from benchtool.export.vehicle import build_vehicle

    file, text = file_for(build_vehicle(RunsFolder(root).path_of(name)), to)
    return file, text.encode("utf-8")


def view_over(root: Path, names: Sequence[str], over: Over, thrust_N: float | None) -> PageSection:
    """Return runs, recordings and stands' tables side by side over a quantity.

    Args:
        thrust_N: at which they are ranked; not at all when None.
    """
    from benchtool.report.compare.page import COMPARISON, compare_runs, comparison_sentence
    from benchtool.report.page import Paragraph
    from benchtool.web.drawing import blocks_html

    paths = [RunsFolder(root).path_of(name) for name in names]
    one = compare_runs(paths, over, thrust_N)
    blocks = [block for part in COMPARISON.sections(one) for block in part.blocks]
    at = () if thrust_N is None else ("--at-thrust", f"{thrust_N:g}")
    return PageSection(
        title=f"{len(names)} compared over {over}",
        html=blocks_html([Paragraph(comparison_sentence(one)), *blocks]),
        simulated=one.simulated,
        command=("report", *map(str, paths), "--over", over, *at),
    )


def view_fits(root: Path, names: Sequence[str]) -> PageSection:
    """Return the values of several fits side by side."""
    from benchtool.report.fit.stored_fit import read_stored
    from benchtool.report.fit.tables import fits_table
    from benchtool.web.drawing import blocks_html

    fits = {name: read_stored(RunsFolder(root).path_of(name)) for name in names}
    return PageSection(
        title=f"{len(names)} fits compared",
        html=blocks_html([fits_table({name: one.results for name, one in fits.items()})]),
        simulated=any(one.simulated for one in fits.values()),
    )


def view_comparison(root: Path, names: Sequence[str]) -> PageSection:
    """Return several sweeps in one plot, with the settings that they share."""
    from benchtool.report.sweep.page import COMPARED
    from benchtool.report.sweep.run import read_sweep_run
    from benchtool.web.drawing import blocks_html

    paths = [RunsFolder(root).path_of(name) for name in names]
    if len(paths) < 2:
        raise InputError("choose two sweeps or more to compare")
    report = COMPARED.report([read_sweep_run(path) for path in paths])
    return PageSection(
        title=f"{len(names)} sweeps compared",
        html=blocks_html(report.sections[0].blocks),
        simulated=report.simulated,
        command=("report", *map(str, paths)),
    )


def _report(path: Path, entry: Entry) -> Report:
    stamp = max(item.stat().st_mtime_ns for item in (path, *path.glob("*")) if item.exists())
    return _made(path, entry.kind, stamp)


@lru_cache(maxsize=2)
def _made(path: Path, kind: str, stamp: int) -> Report:
    """Return the report of a run; its figures are drawn when they are shown."""
    del stamp  # another one after every change on the disk
    if kind in SWEEPS:
        from benchtool.report.sweep.page import SWEEP
        from benchtool.report.sweep.run import read_sweep_run

        return SWEEP.report(read_sweep_run(path))
    from benchtool.explain.pitch.replay import ReplayInputs
    from benchtool.report.replay.page import recording_page

    return recording_page(path, ReplayInputs())


def _answer(path: Path, name: str) -> PageSection:
    from benchtool.report.answer.figures import WHICH, WHICH_OF_SEVERAL
    from benchtool.report.answer.overlay import overlay_caption
    from benchtool.report.figure import captions
    from benchtool.report.page import FactTable, Paragraph
    from benchtool.web.drawing import FigureImage, blocks_html

    facts = read_json(path / ANSWER_FILE)
    overlay = overlay_caption(float(facts.get("window_s", 0.0)))
    known = captions("answer") | {"which": WHICH}
    images = {path / f"{key}.svg": known[key] for key in ("gap", "where", "parameters", "which")}
    images |= dict.fromkeys(sorted(path.glob("which_*.svg")), WHICH_OF_SEVERAL)
    images |= dict.fromkeys(sorted(path.glob("overlay_*.svg")), overlay)
    figures = [
        FigureImage(file.read_bytes(), caption)
        for file, caption in images.items()
        if file.is_file()
    ]
    shown = {"verdict": str(facts["verdict"]), "model": str(facts["model"])}
    for which, sources in facts.get("data", {}).items():
        shown[f"recordings to {which}"] = ", ".join(sources)
    if following := facts.get("next_experiment", {}).get("title"):
        shown["next experiment"] = str(following)
    return PageSection(
        title=name,
        html=blocks_html([Paragraph(str(facts["sentence"])), FactTable(shown), *figures]),
        simulated=bool(facts["simulated"]),
        command=("report", str(path)),
    )


def _table(path: Path, name: str) -> PageSection:
    from benchtool.report.page import Paragraph, Table
    from benchtool.web.drawing import blocks_html

    table = read_csv_text(path)
    size = f"{len(table.rows)} rows, {len(table.header)} columns."
    if table.repairs:
        size += f" Repaired while reading: {'; '.join(table.repairs)}."
    first = f"The first {min(HEAD_ROWS, len(table.rows))} rows."
    rows = Table(first, table.header, table.rows[:HEAD_ROWS], text_columns=0)
    return PageSection(title=name, html=blocks_html([Paragraph(size), *stand_blocks(path), rows]))


def report_bytes(root: Path, names: Sequence[str]) -> bytes:
    """Return the report of an entry, or of several sweeps, as an HTML file."""
    from benchtool.report.report_file import page_text

    folder = RunsFolder(root)
    return page_text([folder.path_of(name) for name in names]).encode("utf-8")


def table_bytes(root: Path, name: str, table: str, suffix: str) -> bytes:
    """Return one table of a run as a CSV or Parquet file."""
    return export_table(RunsFolder(root).path_of(name), table, suffix)
