"""Parts that several tabs use: a command to copy, sections made elsewhere, an upload of tables."""

from __future__ import annotations

import asyncio
import shlex
from collections.abc import Awaitable, Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import datetime

from nicegui import events, ui

from benchtool.core.errors import InputError
from benchtool.data.run.runs_folder import MOST_BYTES, RunsFolder, keep_table
from benchtool.web.context import PageContext
from benchtool.web.notifications import notify_error, shows_errors
from benchtool.web.sections import HtmlFragment, PageSection

STYLE = '<link rel="stylesheet" href="/static/shown.css">'


@contextmanager
def titled_card(title: str) -> Iterator[ui.card]:
    """Make a card with its title in the present slot, and give it."""
    with ui.card().classes("w-full") as card:
        ui.label(title).classes("card-title").props("role=heading aria-level=2")
        yield card


def show_facts(place: ui.element, facts: Mapping[str, str]) -> None:
    """Fill a place with names and their texts."""
    place.clear()
    with place:
        for name, text in facts.items():
            ui.label(name)
            ui.label(text)


class LocalSlider(ui.slider):
    """Move a slider in the browser at once, as NiceGUI's text fields do.

    NiceGUI's own slider moves when the server answers: a late answer to an earlier step sets it
    back, and the steps made since are lost.
    """

    LOOPBACK = False


class CommandRow:
    """Show the command line that does the same as the page, with a button that copies it."""

    def __init__(self, words: Sequence[str] = ()) -> None:
        with ui.row(wrap=False).classes("command-row items-center w-full"):
            ui.icon("terminal").props("aria-hidden=true")
            self._text = ui.label().classes("command-text grow").mark("command")
            ui.button(icon="content_copy", on_click=self._copy).props(
                'flat dense round aria-label="Copy the command"'
            )
        self.show(words)

    def show(self, words: Sequence[str]) -> None:
        """Show other words behind `benchtool`."""
        self._text.set_text(shlex.join(["benchtool", *words]))

    def _copy(self) -> None:
        ui.clipboard.write(self._text.text)
        ui.notify("copied", position="bottom-left", timeout=1000)


def show_section(section: PageSection, *, headed: bool = True) -> None:
    """Make the elements of a section in the present slot.

    Args:
        section: made by another process.
        headed: with its title and its command.
    """
    with ui.element("div").classes("shown-body").mark("shown"):
        if headed:
            with ui.row().classes("items-center gap-3"):
                ui.label(section.title).classes("card-title")
                if section.simulated:
                    ui.label("SIMULATED").classes("stamp")
            if section.command:
                CommandRow(section.command)
        for fragment in section.fragments:
            show_fragment(fragment)


def show_fragment(fragment: HtmlFragment) -> None:
    """Make the element of one fragment in the present slot."""
    made = ui.html(fragment.html, sanitize=False)
    made.classes("block-beside" if fragment.beside else "w-full")


def show_waiting(what: str) -> None:
    """Show that something is being made ready, in the present slot."""
    with ui.row().classes("items-center").props("role=status"):
        ui.spinner(size="sm")
        ui.label(what).classes("soft")


class TableUpload:
    """Take CSV files from a browser: checked as untrusted, stored in the runs folder.

    Args:
        context: of the page.
        stored: called with the name of each in the runs folder.
    """

    def __init__(
        self, context: PageContext, stored: Callable[[str], Awaitable[None] | None]
    ) -> None:
        self._context, self._stored = context, stored
        self._folder = RunsFolder(context.runs)
        self._upload = ui.upload(
            label="Or upload a CSV file",
            auto_upload=True,
            max_file_size=MOST_BYTES,
            on_upload=self._received,
            on_rejected=self._rejected,
        )
        self._upload.props('accept=".csv,text/csv,.txt" flat bordered').classes("w-full")

    @shows_errors
    async def _received(self, event: events.UploadEventArguments) -> None:
        try:
            self._context.claim_control()
            size = event.file.size()
            data = await event.file.read() if size <= MOST_BYTES else bytes(MOST_BYTES + 1)
            date = f"{datetime.now().astimezone():%Y-%m-%d}"
            path = await asyncio.to_thread(keep_table, self._folder, event.file.name, data, date)
        finally:
            self._upload.reset()
        following = self._stored(self._folder.name_of(path))
        if following is not None:
            await following

    def _rejected(self) -> None:
        notify_error(
            InputError(
                f"this is no CSV file of at most {MOST_BYTES / 1e6:.0f} MB; choose another, or put "
                f"it into the runs folder yourself"
            )
        )
