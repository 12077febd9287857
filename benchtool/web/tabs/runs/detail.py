"""One thing of the runs folder on the page: its summary, its figures, its downloads."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

from nicegui import ui

from benchtool.data.run.entry import ANSWER_FILE, FIT_FILE, Entry, entry_of
from benchtool.data.run.runs_folder import RunsFolder
from benchtool.data.run.settings import TABLES
from benchtool.web.context import PageContext
from benchtool.web.notifications import shows_errors
from benchtool.web.sections import PageSection
from benchtool.web.tabs.runs.view import (
    report_bytes,
    table_bytes,
    view_comparison,
    view_entry,
    view_part,
)
from benchtool.web.widgets import CommandRow, show_section, show_waiting

DRAWER = "figures"
"""The process that reads runs and draws."""

WRITER = "reports"
"""The process that writes downloads; a long page takes seconds, and nothing waits behind it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Download:
    """Offer one file: one that stands in the runs folder, a table of a run, or the report.

    Attributes:
        label: on its button.
        file: its name where it is downloaded.
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
        return (Download(label="CSV", file=flat, path=entry.name),)
    found = [report_download(flat)]
    if entry.kind == "recording":
        found.append(Download(label="Recording", file=flat, path=entry.name))
    elif entry.kind in ("fit", "explanation"):
        files = [FIT_FILE if entry.kind == "fit" else ANSWER_FILE]
        if entry.state not in ("stopped early", "not converged"):
            files.append("model.toml")
        found += [
            Download(label=file, file=f"{flat}-{file}", path=f"{entry.name}/{file}")
            for file in files
        ]
    else:
        found += [
            Download(label=f"{table}, CSV", file=f"{flat}-{table}.csv", table=table)
            for table in (TABLES if entry.kind == "sweep" else ("samples",))
        ]
        parquet = f"{flat}-samples.parquet"
        found.append(Download(label="samples, Parquet", file=parquet, table="samples"))
    return tuple(found)


def report_download(name: str) -> Download:
    """Return the report of something."""
    return Download(label="Report, HTML", file=f"{name}-report.html")


class RunDetail:
    """Show an entry, or several compared, below the list."""

    def __init__(self, context: PageContext) -> None:
        self._context = context
        self._folder = RunsFolder(context.runs)
        self._turn = 0
        self._place = ui.column().classes("w-full gap-3 scroll-place")

    async def open(self, name: str) -> None:
        """Show one entry.

        Raises:
            BenchtoolError: no such name, or it cannot be read.
        """
        entry = entry_of(self._folder, name)
        found = await self._read(f"reading {name}", view_entry, name)
        if found is None:
            return
        section, parts = found
        with self._place, ui.card().classes("w-full"):
            with self._head(section, f"{entry.kind} {entry.state}".strip()):
                if entry.can_fit:
                    address = f"/?{urlencode({'tab': 'fit', 'data': name})}"
                    fit = ui.button("Fit", icon="functions").props("dense no-caps")
                    fit.on_click(lambda: ui.navigate.to(address))
                for download in downloads(entry):
                    self._button(download, (name,))
            self._body(section)
            for part in parts:
                self._expansion(name, part)

    async def compare(self, names: Sequence[str]) -> None:
        """Show several sweeps in one plot."""
        what = f"comparing {len(names)} sweeps"
        section = await self._read(what, view_comparison, tuple(names))
        if section is None:
            return
        with self._place, ui.card().classes("w-full"):
            with self._head(section, ""):
                self._button(report_download("compared"), tuple(names))
            self._body(section)

    async def _read(self, what: str, work: Callable[..., Any], *arguments: Any) -> Any:
        """Return what is to be shown; None where something newer was opened meanwhile."""
        self._turn += 1
        turn = self._turn
        self._place.clear()
        with self._place:
            show_waiting(what)
        self._place.run_method("scrollIntoView", {"behavior": "smooth", "block": "start"})
        try:
            found = await self._work(DRAWER, work, *arguments)
        finally:
            if turn == self._turn:
                self._place.clear()
        return found if turn == self._turn else None

    def _head(self, section: PageSection, about: str) -> ui.row:
        """Make title and stamp, and return the row of buttons below them."""
        with ui.row().classes("items-center w-full gap-3"):
            ui.label(section.title).classes("card-title").mark("opened")
            ui.label(about).classes("soft")
            if section.simulated:
                ui.label("SIMULATED").classes("stamp")
        return ui.row().classes("w-full gap-2")

    def _body(self, section: PageSection) -> None:
        if section.command:
            CommandRow(section.command)
        show_section(section, headed=False)

    def _button(self, download: Download, names: tuple[str, ...]) -> None:
        button = ui.button(download.label, icon="download").props("outline dense no-caps")
        page = self._place.client

        @shows_errors
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

    async def _content(self, download: Download, names: tuple[str, ...]) -> bytes | Path:
        if download.path:
            return self._folder.file_of(download.path)
        if not download.table:
            return bytes(await self._work(WRITER, report_bytes, names))
        suffix = Path(download.file).suffix
        return bytes(await self._work(WRITER, table_bytes, names[0], download.table, suffix))

    def _expansion(self, name: str, part: str) -> None:
        with ui.expansion(part).classes("w-full") as more:
            place = ui.column().classes("w-full")
        filled = False

        @shows_errors
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
