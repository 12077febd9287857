"""One thing of the runs folder on the page: what it says, its figures, what to take home."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

from nicegui import ui

from benchtool.store.entry import entry_of
from benchtool.store.runs_folder import RunsFolder
from benchtool.web.command_row import CommandRow
from benchtool.web.context import Context
from benchtool.web.runs.jobs import (
    report_bytes,
    table_bytes,
    view_comparison,
    view_entry,
    view_part,
)
from benchtool.web.runs.offer import Offer, offers, report_offer
from benchtool.web.show import show, waiting
from benchtool.web.shown import Shown
from benchtool.web.tell import tells_errors

DRAWER = "figures"
"""The process that reads runs and draws."""

WRITER = "reports"
"""The process that writes downloads; a long page takes seconds, and nothing waits behind it."""


class RunDetail:
    """Show an entry, or several compared, below the list."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._folder = RunsFolder(context.runs)
        self._asked = 0
        self._place = ui.column().classes("w-full gap-3 scroll-place")

    async def open(self, name: str) -> None:
        """Show one entry.

        Raises:
            BenchtoolError: no such name, or it cannot be read.
        """
        entry = entry_of(self._folder, name)
        turn = self._begin(f"reading {name}")
        try:
            shown, parts = await self._work(DRAWER, view_entry, name)
        except Exception:
            self._clear(turn)
            raise
        if self._clear(turn):
            with self._place, ui.card().classes("w-full"):
                with self._head(shown, f"{entry.kind} {entry.state}".strip()):
                    if entry.can_fit:
                        address = f"/?{urlencode({'tab': 'fit', 'data': name})}"
                        fit = ui.button("Fit", icon="functions").props("dense no-caps")
                        fit.on_click(lambda: ui.navigate.to(address))
                    for offer in offers(entry):
                        self._button(offer, (name,))
                self._body(shown)
                for part in parts:
                    self._expansion(name, part)

    async def compare(self, names: Sequence[str]) -> None:
        """Show several sweeps in one plot."""
        turn = self._begin(f"comparing {len(names)} sweeps")
        try:
            shown = await self._work(DRAWER, view_comparison, tuple(names))
        except Exception:
            self._clear(turn)
            raise
        if self._clear(turn):
            with self._place, ui.card().classes("w-full"):
                with self._head(shown, ""):
                    self._button(report_offer("compared"), tuple(names))
                self._body(shown)

    def _head(self, shown: Shown, said: str) -> ui.row:
        """Make title and stamp, and return the row of buttons below them."""
        with ui.row().classes("items-center w-full gap-3"):
            ui.label(shown.title).classes("card-title").mark("opened")
            ui.label(said).classes("soft")
            if shown.simulated:
                ui.label("SIMULATED").classes("stamp")
        return ui.row().classes("w-full gap-2")

    def _body(self, shown: Shown) -> None:
        if shown.command:
            CommandRow(shown.command)
        show(shown, headed=False)

    def _button(self, offer: Offer, names: tuple[str, ...]) -> None:
        button = ui.button(offer.label, icon="download").props("outline dense no-caps")
        page = self._place.client

        @tells_errors
        async def take() -> None:
            button.props("loading")
            try:
                made = await self._made(offer, names)
            finally:
                button.props(remove="loading")
            # Another entry may have been opened meanwhile, so that the button is no more.
            with page:
                ui.download(made, offer.file)

        button.on_click(take)

    async def _made(self, offer: Offer, names: tuple[str, ...]) -> bytes | Path:
        if offer.path:
            return self._folder.file_of(offer.path)
        if offer.report:
            return bytes(await self._work(WRITER, report_bytes, names))
        return bytes(await self._work(WRITER, table_bytes, names[0], offer.table, offer.suffix))

    def _expansion(self, name: str, part: str) -> None:
        with ui.expansion(part).classes("w-full") as more:
            place = ui.column().classes("w-full")
        filled: list[str] = []

        @tells_errors
        async def fill() -> None:
            if filled or not more.value:
                return
            filled.append(part)
            with place:
                waiting(f"drawing {part.lower()}")
            try:
                shown = await self._work(DRAWER, view_part, name, part)
            finally:
                place.clear()
            with place:
                show(shown, headed=False)

        more.on_value_change(fill)

    async def _work(self, who: str, job: Callable[..., Any], *rest: Any) -> Any:
        return await self._context.worker(who).run(job, self._folder.root, *rest)

    def _begin(self, what: str) -> int:
        self._asked += 1
        self._place.clear()
        with self._place:
            waiting(what)
        self._place.run_method("scrollIntoView", {"behavior": "smooth", "block": "start"})
        return self._asked

    def _clear(self, turn: int) -> bool:
        """Take away what says that one waits; tell whether nothing newer was asked for."""
        if turn == self._asked:
            self._place.clear()
        return turn == self._asked
