"""Detail view of entries of the runs folder: summary, figures and downloads."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from nicegui import ui

from benchtool.data.run.entry import ANSWER_FILE, FIT_FILE, SWEEPS, Entry, build_entry
from benchtool.data.run.points import TABLES
from benchtool.data.run.runs_folder import RunsFolder
from benchtool.export.targets import TARGETS
from benchtool.web.context import PageContext
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
    add_section_expansion,
    open_tab,
    show_errors,
    show_section,
    show_spinner,
    show_title,
)

EXPORTABLE_KINDS = ("fit", *SWEEPS)
FIGURE_WORKER = "figures"  # process that reads runs and draws
EXPORT_WORKER = "reports"  # process that writes downloads


class Download(NamedTuple):
    """Downloadable file; `function` returns its contents in a worker process, None: a path."""

    label: str
    file: str
    function: Callable[..., bytes] | None
    arguments: tuple[Any, ...]


def downloads(entry: Entry) -> tuple[Download, ...]:
    """Return the downloads of an entry; () for an unreadable one."""
    if entry.problem:
        return ()
    name, flat = entry.name, entry.name.replace("/", "-")
    if entry.kind == "table":
        return (Download("CSV", flat, None, (name,)),)
    report = report_download(flat, (name,))
    if entry.kind == "recording":
        return report, Download("Recording", flat, None, (name,))
    if entry.kind in ("fit", "explanation"):
        files = [FIT_FILE if entry.kind == "fit" else ANSWER_FILE]
        if entry.state not in ("stopped early", "not converged"):
            files.append("model.toml")
        return report, *(
            Download(file, f"{flat}-{file}", None, (f"{name}/{file}",)) for file in files
        )
    tables = [(table, "CSV") for table in (TABLES if entry.kind in SWEEPS else ("samples",))]
    return report, *(
        Download(
            f"{table}, {label}",
            f"{flat}-{table}.{label.lower()}",
            table_bytes,
            (name, table, f".{label.lower()}"),
        )
        for table, label in (*tables, ("samples", "Parquet"))
    )


def report_download(name: str, entries: tuple[str, ...]) -> Download:
    """Return the download of a report."""
    return Download("Report, HTML", f"{name}-report.html", report_bytes, (entries,))


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
            show_title(section, f"{entry.kind} {entry.state}".strip())
            with ui.row().classes("w-full gap-2"):
                if entry.can_fit:
                    fit = ui.button("Fit", icon="functions").props("dense")
                    fit.on_click(lambda: open_tab("fit", data=name))
                for download in downloads(entry):
                    self._add_download(download)
                has_export = entry.kind in EXPORTABLE_KINDS or MOTOR_PART in part_titles
                if not entry.problem and has_export:
                    self._add_export(name)
            show_section(section, has_title=False)
            for title in part_titles:
                load = partial(self._context.compute, FIGURE_WORKER, view_part, name, title)
                add_section_expansion(title, load, f"drawing {title.lower()}")

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
            show_title(section)
            if has_ratios:
                self._add_download(report_download("compared", names))
            show_section(section, has_title=False)

    async def _load(self, text: str, function: Callable[..., Any], *arguments: Any) -> Any:
        """Return the result of a worker function, or None if another entry was opened meanwhile."""
        self._request_number += 1
        number = self._request_number
        self._container.clear()
        with self._container:
            show_spinner(text)
        self._container.run_method("scrollIntoView", {"behavior": "smooth", "block": "start"})
        try:
            result = await self._context.compute(FIGURE_WORKER, function, *arguments)
        finally:
            if number == self._request_number:
                self._container.clear()
        return result if number == self._request_number else None

    def _add_download(self, download: Download) -> None:
        async def load() -> tuple[str, bytes | Path]:
            if download.function is None:
                return download.file, self._folder.find_file(*download.arguments)
            content = await self._context.compute(
                EXPORT_WORKER, download.function, *download.arguments
            )
            return download.file, content

        self._add_save(download.label, "download", load)

    def _add_export(self, name: str) -> None:
        """Add a download of the files of `benchtool export`."""
        titles = {key: target.title.partition(":")[0] for key, target in TARGETS.items()}

        async def load() -> tuple[str, bytes | Path]:
            file, content = await self._context.compute(
                EXPORT_WORKER, export_file, name, target.value
            )
            return file, content

        with ui.row().classes("items-center gap-1"):
            target = ui.select(titles, value="ardupilot", label="For")
            target.props("dense").classes("w-40")
            self._add_save("Export", "flight", load)

    def _add_save(
        self, label: str, icon: str, load: Callable[[], Awaitable[tuple[str, bytes | Path]]]
    ) -> None:
        """Add a button that saves a file; `load` returns its name and content."""
        button = ui.button(label, icon=icon).props("outline dense")
        page = self._container.client

        @show_errors
        async def save() -> None:
            button.props("loading")
            try:
                file, content = await load()
            finally:
                button.props(remove="loading")
            # In the page's slot: opening another entry deletes the button.
            with page:
                ui.download(content, file)

        button.on_click(save)
