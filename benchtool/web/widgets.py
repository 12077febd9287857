"""Parts that several tabs use: notifications, commands to copy, uploads, the dialog that arms."""

from __future__ import annotations

import shlex
import traceback
from collections.abc import Awaitable, Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import datetime
from functools import wraps
from inspect import isawaitable, iscoroutinefunction
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

from nicegui import Client, events, ui

from benchtool.acquire.arming import CONFIRMATION, arming_warnings
from benchtool.bench.bench import DeviceInfo
from benchtool.commands.import_file import ImportInputs
from benchtool.core.errors import BenchtoolError, InputError
from benchtool.core.rig import Rig
from benchtool.data.run.runs_folder import MAX_UPLOAD_BYTES
from benchtool.web.bench_process.messages import Notice
from benchtool.web.context import PageContext
from benchtool.web.control_socket import PAGES
from benchtool.web.jobs import PageSection, format_fault
from benchtool.web.uploads import store_upload

STYLE = (
    '<link rel="stylesheet" href="/static/shown.css"><script src="/static/shown.js" defer></script>'
)


def today() -> str:
    """Return the date here, as names of folders begin with it."""
    return f"{datetime.now().astimezone():%Y-%m-%d}"


def open_tab(tab: str, **query: str) -> None:
    """Open another tab, with parameters in its address."""
    ui.navigate.to(f"/?{urlencode({'tab': tab, **query})}")


# --- notifications ------------------------------------------------------------------------------


def log_message(text: str, *, is_error: bool = False) -> None:
    """Add to the server's log of messages what the present page shows."""
    if (context := PAGES.get(ui.context.client.id)) is not None:
        context.server.log.add(text, is_error=is_error)


def notify(text: str, *, logged: bool = False) -> None:
    """Show a short note, and log it unless it is logged already."""
    if not logged:
        log_message(text)
    ui.notify(text, type="info", position="bottom-left")


def notify_error(error: Exception, *, logged: bool = False) -> None:
    """Show why something was refused or failed, until it is closed: the command line's sentence."""
    known = isinstance(error, BenchtoolError)
    if not known:
        traceback.print_exception(error)
    text = str(error) if known else format_fault(error)
    if not logged:
        log_message(text, is_error=True)
    ui.notify(
        text,
        type="negative", position="bottom-left", multi_line=True, timeout=0, close_button="Close",
    )  # fmt: skip


def notify_all_pages(notice: Notice) -> None:
    """Show a notice of the bench process on every page."""
    for client in list(Client.instances.values()):
        if client.has_socket_connection:
            with client:
                if notice.is_error:
                    notify_error(BenchtoolError(notice.text), logged=True)
                else:
                    notify(notice.text, logged=True)


def show_errors(handler: Callable[..., Any]) -> Callable[..., Any]:
    """Make a handler of the page show its errors instead of losing them in a log."""
    if iscoroutinefunction(handler):

        @wraps(handler)
        async def waiting(*args: Any, **kwargs: Any) -> Any:
            page = ui.context.client
            try:
                return await handler(*args, **kwargs)
            except Exception as error:  # noqa: BLE001 -- the boundary where errors are shown
                # On the page, not where the handler began: that card may be gone by now.
                with page:
                    notify_error(error)

        return waiting

    @wraps(handler)
    def at_once(*args: Any, **kwargs: Any) -> Any:
        try:
            return handler(*args, **kwargs)
        except Exception as error:  # noqa: BLE001 -- as above
            notify_error(error)

    return at_once


# --- parts --------------------------------------------------------------------------------------


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
            self._text = ui.label().classes("command-text grow")
            ui.button(icon="content_copy", on_click=self._copy).props(
                'flat dense round aria-label="Copy the command"'
            )
        self.show(words)

    def show(self, words: Sequence[str]) -> None:
        self._text.set_text(shlex.join(["benchtool", *words]))

    def _copy(self) -> None:
        ui.clipboard.write(self._text.text)
        ui.notify("copied", position="bottom-left", timeout=1000)


def show_stamp(simulated: bool) -> None:
    """Mark what no physical bench made."""
    if simulated:
        ui.label("SIMULATED").classes("stamp")


def show_section(section: PageSection, *, headed: bool = True) -> None:
    """Make the elements of a section in the present slot, with its title and command if headed."""
    if headed:
        with ui.row().classes("items-center gap-3"):
            ui.label(section.title).classes("card-title")
            show_stamp(section.simulated)
        if section.command:
            CommandRow(section.command)
    ui.html(section.html, sanitize=False).classes("shown-body")


def show_waiting(what: str) -> None:
    """Show that something is being made ready, in the present slot."""
    with ui.row().classes("items-center").props("role=status"):
        ui.spinner(size="sm")
        ui.label(what).classes("soft")


def multiple_choice(label: str, changed: Callable[[], object]) -> ui.select:
    """Make a list of which several can be chosen, and that can be searched."""
    choice = ui.select({}, multiple=True, label=label, on_change=changed)
    return choice.props("use-chips use-input input-debounce=0").classes("w-full")


UPLOADED = ".csv,text/csv,.txt,.log,.bin,.ulg,.tlog"  # of files that an import may read
UPLOAD_HEAD = """
<q-btn flat icon="add" label="LABEL" class="w-full" @click="props.pickFiles" />
<span style="display: none"><q-uploader-add-trigger /></span>
"""
"""Quasar's own head puts the input into a link without a name; a screen reader finds neither."""


def file_upload(label: str, **options: Any) -> ui.upload:
    """Make a place where a file is dropped, or chosen by a button of that name."""
    upload = ui.upload(auto_upload=True, **options)
    upload.add_slot("header", UPLOAD_HEAD.replace("LABEL", label))
    return upload


class TableUpload:
    """Take tables and logs from a browser: checked as untrusted, stored in the runs folder.

    Args:
        stored: called with the name of each file in the folder.
        options: of the import; those of the command when left out.
    """

    def __init__(
        self,
        context: PageContext,
        stored: Callable[[str], Awaitable[None] | None],
        options: Callable[[ImportInputs], ImportInputs] = lambda inputs: inputs,
    ) -> None:
        self._context, self._stored, self._options = context, stored, options
        self._upload = file_upload(
            "Or upload a CSV file or a log",
            max_file_size=MAX_UPLOAD_BYTES,
            on_upload=self._received,
            on_rejected=self._rejected,
        )
        self._upload.props(f'accept="{UPLOADED}" flat bordered').classes("w-full")

    @show_errors
    async def _received(self, event: events.UploadEventArguments) -> None:
        try:
            self._context.claim_control()
            size = event.file.size()
            data = (
                await event.file.read() if size <= MAX_UPLOAD_BYTES else bytes(MAX_UPLOAD_BYTES + 1)
            )
            name = event.file.name
            inputs = self._options(ImportInputs(files=(Path(name),)))
            stored = await self._context.worker("tables").run(
                store_upload, self._context.runs, name, data, today(), inputs
            )
        finally:
            self._upload.reset()
        following = self._stored(stored)
        if isawaitable(following):
            await following

    def _rejected(self) -> None:
        notify_error(
            InputError(
                f"this is no table or log of at most {MAX_UPLOAD_BYTES / 1e6:.0f} MB; choose "
                f"another, or put it into the runs folder yourself"
            )
        )


# --- dialogs ------------------------------------------------------------------------------------


@contextmanager
def open_dialog(title: str) -> Iterator[ui.dialog]:
    """Open a dialog that is filled in the block; closed, it is gone with all that is in it."""
    named = ui.dialog().props(f'aria-label="{title}"')
    with named as dialog, ui.card().classes("w-96"):
        ui.label(title).classes("card-title").props("role=heading aria-level=2")
        yield dialog
    dialog.on_value_change(lambda change: None if change.value else dialog.delete())
    dialog.open()


def confirm_arming(
    context: PageContext, place: ui.element, text: str, begin: Callable[[str, bool], object]
) -> None:
    """Ask before motors turn: what will spin, and the typed word unless the bench is simulated.

    Args:
        place: what stays when the dialog is gone; errors are shown there.
        begin: called with what was typed, empty on a simulated bench, and whether the run needs
            this page.
    """
    connection = context.bench.connection
    identity, rig = connection.identity, connection.rig
    simulated = identity is not None and identity.simulated
    with open_dialog("About to spin") as dialog:
        ui.label(text).style("white-space: pre-line")
        if identity is not None and rig is not None:
            show_warnings(identity, rig)
        typed = ui.input(f"Type {CONFIRMATION} to arm").classes("w-full")
        typed.set_visibility(not simulated)
        if simulated:
            ui.label("A simulated bench: no motor turns.").classes("soft")
        without_page = ui.checkbox("Let it run without this page")
        ui.label(
            "Off: motors go to zero when this page is closed, blocked or loses its connection."
        ).classes("soft")

        @show_errors
        def confirmed() -> None:
            context.require_control()
            if not simulated and not typed.value.strip():
                raise InputError(f"not armed: {CONFIRMATION} was not typed; nothing was spun")
            begin("" if simulated else typed.value, not without_page.value)

        def press() -> None:
            # In a place that stays: a dialog that is closed is gone with all that is in it.
            with place:
                confirmed()
            dialog.close()

        with ui.row():
            ui.button("Start", icon="play_arrow", on_click=press)
            ui.button("Cancel", on_click=dialog.close).props("outline")


def show_warnings(identity: DeviceInfo, rig: Rig) -> None:
    """Show the command line's warnings about a bench before it is armed."""
    for warning in arming_warnings(identity, rig):
        ui.label(f"Warning: {warning}").classes("warn")
