"""Detail view of entries of the runs folder: summary, figures and downloads."""

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
    show_spinner,
    show_stamp,
)

EXPORTABLE_KINDS = ("fit", *SWEEPS)
FIGURE_WORKER = "figures"  # process that reads runs and draws
EXPORT_WORKER = "reports"  # process that writes downloads


class Download(NamedTuple):
    """Downloadable file: a file of the runs folder, a table of a run, or the report.

    Attributes:
        path: in the runs folder; "" for a table or the report.
        table: of a run, to be exported; "" for others.
    """

    label: str
    file: str
    path: str = ""
    table: str = ""


def downloads(entry: Entry) -> tuple[Download, ...]:
    """Return the downloads of an entry; () for an unreadable one."""
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
    """Return the download of a report."""
    return Download("Report, HTML", f"{name}-report.html")


class RunDetail:
    """View of one entry, or of several compared, below the list."""

    def __init__(self, context: PageContext) -> None:
        self._context = context
        self._folder = RunsFolder(context.runs)
        self._request_number = 0
        self._container = ui.column().classes("w-full gap-3 scroll-place")

    async def open(self, name: str) -> None:
        """Show one entry."""
        entry = build_entry(self._folder, name)
        result = await self._load(f"reading {name}", view_entry, name)
        if result is None:
            return
        section, part_titles = result
        with self._container, ui.card().classes("w-full"):
            with self._add_header(section, f"{entry.kind} {entry.state}".strip()):
                if entry.can_fit:
                    fit = ui.button("Fit", icon="functions").props("dense")
                    fit.on_click(lambda: open_tab("fit", data=name))
                for download in downloads(entry):
                    self._add_download(download, (name,))
                has_export = entry.kind in EXPORTABLE_KINDS or MOTOR_PART in part_titles
                if not entry.problem and has_export:
                    self._add_export(name)
            self._add_body(section)
            for title in part_titles:
                self._add_expansion(name, title)

    async def compare(
        self, entries: Sequence[Entry], over: str = "", thrust_N: float | None = None
    ) -> None:
        """Show a comparison of entries.

        Args:
            over: horizontal axis for runs and recordings; "" for thrust ratios of sweeps.
            thrust_N: thrust at which they are ranked; None for no ranking.
        """
        kinds, names = {entry.kind for entry in entries}, tuple(entry.name for entry in entries)
        text, has_ratios = f"comparing {len(names)}", kinds <= {*SWEEPS} and not over
        if kinds == {"fit"}:
            section = await self._load(text, view_fits, names)
        elif has_ratios:
            section = await self._load(text, view_comparison, names)
        else:
            section = await self._load(text, view_over, names, over or "thrust", thrust_N)
        if section is None:
            return
        with self._container, ui.card().classes("w-full"):
            with self._add_header(section, ""):
                if has_ratios:
                    self._add_download(report_download("compared"), names)
            self._add_body(section)

    async def _load(self, text: str, function: Callable[..., Any], *arguments: Any) -> Any:
        """Return the result of a worker function, or None if another entry was opened meanwhile."""
        self._request_number += 1
        number = self._request_number
        self._container.clear()
        with self._container:
            show_spinner(text)
        self._container.run_method("scrollIntoView", {"behavior": "smooth", "block": "start"})
        try:
            result = await self._run(FIGURE_WORKER, function, *arguments)
        finally:
            if number == self._request_number:
                self._container.clear()
        return result if number == self._request_number else None

    def _add_header(self, section: PageSection, subtitle: str) -> ui.row:
        with ui.row().classes("items-center w-full gap-3"):
            ui.label(section.title).classes("card-title")
            ui.label(subtitle).classes("soft")
            show_stamp(section.simulated)
        return ui.row().classes("w-full gap-2")

    def _add_body(self, section: PageSection) -> None:
        if section.command:
            CommandRow(section.command)
        show_section(section, has_header=False)

    def _add_download(self, download: Download, names: tuple[str, ...]) -> None:
        button = ui.button(download.label, icon="download").props("outline dense")
        page = self._container.client

        @show_errors
        async def save() -> None:
            button.props("loading")
            try:
                content = await self._load_content(download, names)
            finally:
                button.props(remove="loading")
            # In the page's slot: opening another entry deletes the button.
            with page:
                ui.download(content, download.file)

        button.on_click(save)

    def _add_export(self, name: str) -> None:
        """Add a download of the files of `benchtool export`."""
        titles = {key: target.title.partition(":")[0] for key, target in TARGETS.items()}
        with ui.row().classes("items-center gap-1"):
            target = (
                ui.select(titles, value="ardupilot", label="For").props("dense").classes("w-40")
            )
            button = ui.button("Export", icon="flight").props("outline dense")
        page = self._container.client

        @show_errors
        async def save() -> None:
            button.props("loading")
            try:
                file, content = await self._run(EXPORT_WORKER, export_file, name, target.value)
            finally:
                button.props(remove="loading")
            with page:
                ui.download(content, file)

        button.on_click(save)

    async def _load_content(self, download: Download, names: tuple[str, ...]) -> bytes | Path:
        if download.path:
            return self._folder.find_file(download.path)
        if not download.table:
            return bytes(await self._run(EXPORT_WORKER, report_bytes, names))
        suffix = Path(download.file).suffix
        return bytes(await self._run(EXPORT_WORKER, table_bytes, names[0], download.table, suffix))

    def _add_expansion(self, name: str, title: str) -> None:
        with ui.expansion(title).classes("w-full") as expansion:
            container = ui.column().classes("w-full")
        is_filled = False

        @show_errors
        async def fill() -> None:
            nonlocal is_filled
            if is_filled or not expansion.value:
                return
            is_filled = True
            with container:
                show_spinner(f"drawing {title.lower()}")
            try:
                section = await self._run(FIGURE_WORKER, view_part, name, title)
            finally:
                container.clear()
            with container:
                show_section(section, has_header=False)

        expansion.on_value_change(fill)

    async def _run(self, worker: str, function: Callable[..., Any], *arguments: Any) -> Any:
        return await self._context.worker(worker).run(function, self._folder.root, *arguments)
