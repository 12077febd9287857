"""One thing of the runs folder on the page: its summary, its figures, its downloads."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from nicegui import ui

from benchtool.data.run.entry import ANSWER_FILE, FIT_FILE, SWEEPS, Entry, build_entry
from benchtool.data.run.runs_folder import RunsFolder
from benchtool.data.run.settings import TABLES
from benchtool.export.targets import TARGETS
from benchtool.web.context import PageContext
from benchtool.web.jobs import PageSection
from benchtool.web.tabs.runs.view import (
    MOTOR_PART,
    export_file,
    report_bytes,
    table_bytes,
    view_comparison,
    view_entry,
    view_fits,
    view_over,
    view_part,
)
from benchtool.web.widgets import (
    CommandRow,
    open_tab,
    show_errors,
    show_section,
    show_stamp,
    show_waiting,
)

EXPORTED = ("fit", *SWEEPS)  # kinds with values to export
DRAWER = "figures"  # The process that reads runs and draws

EXPORT_WRITER = "reports"  # process that writes downloads


class Download(NamedTuple):
    """Offer one file: one that stands in the runs folder, a table of a run, or the report.

    Attributes:
        path: in the runs folder; empty for a table and the report.
        table: of a run, to be exported; empty for others.
    """

    label: str
    file: str
    path: str = ""
    table: str = ""


def downloads(entry: Entry) -> tuple[Download, ...]:
    """Return what an entry offers; nothing that cannot be read offers anything."""
    if entry.problem:
        return ()
    flat = entry.name.replace("/", "-")
    if entry.kind == "table":
        return (Download("CSV", flat, path=entry.name),)
    report = report_download(flat)
    if entry.kind == "recording":
        return report, Download("Recording", flat, path=entry.name)
    if entry.kind in ("fit", "explanation"):
        files = [FIT_FILE if entry.kind == "fit" else ANSWER_FILE]
        if entry.state not in ("stopped early", "not converged"):
            files.append("model.toml")
        return report, *(
            Download(file, f"{flat}-{file}", path=f"{entry.name}/{file}") for file in files
        )
    tables = TABLES if entry.kind in SWEEPS else ("samples",)
    return (
        report,
        *(Download(f"{table}, CSV", f"{flat}-{table}.csv", table=table) for table in tables),
        Download("samples, Parquet", f"{flat}-samples.parquet", table="samples"),
    )


def report_download(name: str) -> Download:
    """Return the report of something."""
    return Download("Report, HTML", f"{name}-report.html")


class RunDetail:
    """Show an entry, or several compared, below the list."""

    def __init__(self, context: PageContext) -> None:
        self._context = context
        self._folder = RunsFolder(context.runs)
        self._number = 0
        self._place = ui.column().classes("w-full gap-3 scroll-place")

    async def open(self, name: str) -> None:
        """Show one entry.

        Raises:
            BenchtoolError: no such name, or it cannot be read.
        """
        entry = build_entry(self._folder, name)
        found = await self._read(f"reading {name}", view_entry, name)
        if found is None:
            return
        section, parts = found
        with self._place, ui.card().classes("w-full"):
            with self._head(section, f"{entry.kind} {entry.state}".strip()):
                if entry.can_fit:
                    fit = ui.button("Fit", icon="functions").props("dense")
                    fit.on_click(lambda: open_tab("fit", data=name))
                for download in downloads(entry):
                    self._button(download, (name,))
                if not entry.problem and (entry.kind in EXPORTED or MOTOR_PART in parts):
                    self._export(name)
            self._body(section)
            for part in parts:
                self._expansion(name, part)

    async def compare(
        self, entries: Sequence[Entry], over: str = "", thrust_N: float | None = None
    ) -> None:
        """Show several side by side.

        Args:
            over: what runs and recordings are drawn over; thrust ratios of sweeps when empty.
            thrust_N: at which they are ranked then; not at all when None.
        """
        kinds, names = {entry.kind for entry in entries}, tuple(entry.name for entry in entries)
        what, ratios = f"comparing {len(names)}", kinds <= {*SWEEPS} and not over
        if kinds == {"fit"}:
            section = await self._read(what, view_fits, names)
        elif ratios:
            section = await self._read(what, view_comparison, names)
        else:
            section = await self._read(what, view_over, names, over or "thrust", thrust_N)
        if section is None:
            return
        with self._place, ui.card().classes("w-full"):
            with self._head(section, ""):
                if ratios:
                    self._button(report_download("compared"), names)
            self._body(section)

    async def _read(self, what: str, work: Callable[..., Any], *arguments: Any) -> Any:
        """Return what is to be shown; None where something newer was opened meanwhile."""
        self._number += 1
        number = self._number
        self._place.clear()
        with self._place:
            show_waiting(what)
        self._place.run_method("scrollIntoView", {"behavior": "smooth", "block": "start"})
        try:
            found = await self._work(DRAWER, work, *arguments)
        finally:
            if number == self._number:
                self._place.clear()
        return found if number == self._number else None

    def _head(self, section: PageSection, about: str) -> ui.row:
        with ui.row().classes("items-center w-full gap-3"):
            ui.label(section.title).classes("card-title")
            ui.label(about).classes("soft")
            show_stamp(section.simulated)
        return ui.row().classes("w-full gap-2")

    def _body(self, section: PageSection) -> None:
        if section.command:
            CommandRow(section.command)
        show_section(section, headed=False)

    def _button(self, download: Download, names: tuple[str, ...]) -> None:
        button = ui.button(download.label, icon="download").props("outline dense")
        page = self._place.client

        @show_errors
        async def take() -> None:
            button.props("loading")
            try:
                content = await self._content(download, names)
            finally:
                button.props(remove="loading")
            # Another entry may have been opened meanwhile, so that the button is no more.
            with page:
                ui.download(content, download.file)

        button.on_click(take)

    def _export(self, name: str) -> None:
        """Offer the files of `benchtool export`."""
        titles = {to: target.title.partition(":")[0] for to, target in TARGETS.items()}
        with ui.row().classes("items-center gap-1"):
            to = ui.select(titles, value="ardupilot", label="For").props("dense").classes("w-40")
            button = ui.button("Export", icon="flight").props("outline dense")
        page = self._place.client

        @show_errors
        async def take() -> None:
            button.props("loading")
            try:
                file, content = await self._work(EXPORT_WRITER, export_file, name, to.value)
            finally:
                button.props(remove="loading")
            with page:
                ui.download(content, file)

        button.on_click(take)

    async def _content(self, download: Download, names: tuple[str, ...]) -> bytes | Path:
        if download.path:
            return self._folder.file_of(download.path)
        if not download.table:
            return bytes(await self._work(EXPORT_WRITER, report_bytes, names))
        suffix = Path(download.file).suffix
        return bytes(await self._work(EXPORT_WRITER, table_bytes, names[0], download.table, suffix))

    def _expansion(self, name: str, part: str) -> None:
        with ui.expansion(part).classes("w-full") as more:
            place = ui.column().classes("w-full")
        filled = False

        @show_errors
        async def fill() -> None:
            nonlocal filled
            if filled or not more.value:
                return
            filled = True
            with place:
                show_waiting(f"drawing {part.lower()}")
            try:
                section = await self._work(DRAWER, view_part, name, part)
            finally:
                place.clear()
            with place:
                show_section(section, headed=False)

        more.on_value_change(fill)

    async def _work(self, worker: str, work: Callable[..., Any], *arguments: Any) -> Any:
        return await self._context.worker(worker).run(work, self._folder.root, *arguments)
