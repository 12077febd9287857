"""Shared widgets: notifications, command rows, uploads and the arming dialog."""

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

from benchtool.acquire.operator import CONFIRMATION, arming_warnings
from benchtool.bench.bench import DeviceInfo
from benchtool.commands.import_file import ImportInputs
from benchtool.core.errors import BenchtoolError, InputError
from benchtool.core.rig import Rig
from benchtool.data.run.runs_folder import MAX_UPLOAD_BYTES
from benchtool.web.bench_process.messages import Notice
from benchtool.web.context import PageContext
from benchtool.web.control_socket import PAGES
from benchtool.web.jobs import PageSection, format_internal_error
from benchtool.web.uploads import store_upload

STYLE = (
    '<link rel="stylesheet" href="/static/shown.css"><script src="/static/shown.js" defer></script>'
)


def today() -> str:
    """Return the local date, the prefix of folder names."""
    return f"{datetime.now().astimezone():%Y-%m-%d}"


def open_tab(tab: str, **query: str) -> None:
    """Open another tab with query parameters."""
    ui.navigate.to(f"/?{urlencode({'tab': tab, **query})}")


# --- notifications ------------------------------------------------------------------------------


def log_message(text: str, *, is_error: bool = False) -> None:
    """Add a message of the current page to the server's message history."""
    if (context := PAGES.get(ui.context.client.id)) is not None:
        context.server.log.add(text, is_error=is_error)


def notify(text: str, *, logged: bool = False) -> None:
    """Show a notification and log it, unless already logged."""
    if not logged:
        log_message(text)
    ui.notify(text, type="info", position="bottom-left")


def notify_error(error: Exception, *, logged: bool = False) -> None:
    """Show an error notification with the message of the command line until it is closed."""
    is_expected = isinstance(error, BenchtoolError)
    if not is_expected:
        traceback.print_exception(error)
    text = str(error) if is_expected else format_internal_error(error)
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
    """Wrap a handler so that its errors are shown as notifications."""
    if iscoroutinefunction(handler):

        @wraps(handler)
        async def run_async(*args: Any, **kwargs: Any) -> Any:
            page = ui.context.client
            try:
                return await handler(*args, **kwargs)
            except Exception as error:  # noqa: BLE001 -- the boundary where errors are shown
                # In the page's slot: the card of the handler may have been deleted.
                with page:
                    notify_error(error)

        return run_async

    @wraps(handler)
    def run_sync(*args: Any, **kwargs: Any) -> Any:
        try:
            return handler(*args, **kwargs)
        except Exception as error:  # noqa: BLE001 -- as above
            notify_error(error)

    return run_sync


# --- elements -----------------------------------------------------------------------------------


@contextmanager
def titled_card(title: str) -> Iterator[ui.card]:
    """Create a card with a title in the current slot."""
    with ui.card().classes("w-full") as card:
        ui.label(title).classes("card-title").props("role=heading aria-level=2")
        yield card


def show_facts(container: ui.element, facts: Mapping[str, str]) -> None:
    """Replace the contents of a container by labels: each name, then its text."""
    container.clear()
    with container:
        for name, text in facts.items():
            ui.label(name)
            ui.label(text)


class LocalSlider(ui.slider):
    """Slider that moves in the browser without a round trip to the server.

    NiceGUI's slider moves on the server's response: a late response resets it and later steps are
    lost.
    """

    LOOPBACK = False


class CommandRow:
    """Equivalent command line with a copy button."""

    def __init__(self, arguments: Sequence[str] = ()) -> None:
        with ui.row(wrap=False).classes("command-row items-center w-full"):
            ui.icon("terminal").props("aria-hidden=true")
            self._text = ui.label().classes("command-text grow")
            ui.button(icon="content_copy", on_click=self._copy).props(
                'flat dense round aria-label="Copy the command"'
            )
        self.show(arguments)

    def show(self, arguments: Sequence[str]) -> None:
        self._text.set_text(shlex.join(["benchtool", *arguments]))

    def _copy(self) -> None:
        ui.clipboard.write(self._text.text)
        ui.notify("copied", position="bottom-left", timeout=1000)


def show_stamp(simulated: bool) -> None:
    """Show the stamp of simulated data."""
    if simulated:
        ui.label("SIMULATED").classes("stamp")


def show_section(section: PageSection, *, has_header: bool = True) -> None:
    """Create a section in the current slot, by default with title and command."""
    if has_header:
        with ui.row().classes("items-center gap-3"):
            ui.label(section.title).classes("card-title")
            show_stamp(section.simulated)
        if section.command:
            CommandRow(section.command)
    ui.html(section.html, sanitize=False).classes("shown-body")


def show_spinner(text: str) -> None:
    """Show a spinner with a text in the current slot."""
    with ui.row().classes("items-center").props("role=status"):
        ui.spinner(size="sm")
        ui.label(text).classes("soft")


def multiple_choice(label: str, on_change: Callable[[], object]) -> ui.select:
    """Create a searchable select with multiple choice."""
    select = ui.select({}, multiple=True, label=label, on_change=on_change)
    return select.props("use-chips use-input input-debounce=0").classes("w-full")


UPLOAD_TYPES = ".csv,text/csv,.txt,.log,.bin,.ulg,.tlog"  # readable by an import
UPLOAD_HEADER = """
<q-btn flat icon="add" label="LABEL" class="w-full" @click="props.pickFiles" />
<span style="display: none"><q-uploader-add-trigger /></span>
"""
"""Accessible header; Quasar's header hides the input in an unnamed link."""


def file_upload(label: str, **options: Any) -> ui.upload:
    """Create an upload area with a labelled button."""
    upload = ui.upload(auto_upload=True, **options)
    upload.add_slot("header", UPLOAD_HEADER.replace("LABEL", label))
    return upload


class TableUpload:
    """Upload of untrusted tables and logs into the runs folder.

    Args:
        on_stored: called with the name of each file in the folder.
        add_options: adds import options to the inputs; default: none.
    """

    def __init__(
        self,
        context: PageContext,
        on_stored: Callable[[str], Awaitable[None] | None],
        add_options: Callable[[ImportInputs], ImportInputs] = lambda inputs: inputs,
    ) -> None:
        self._context, self._on_stored, self._add_options = context, on_stored, add_options
        self._upload = file_upload(
            "Or upload a CSV file or a log",
            max_file_size=MAX_UPLOAD_BYTES,
            on_upload=self._on_upload,
            on_rejected=self._on_rejected,
        )
        self._upload.props(f'accept="{UPLOAD_TYPES}" flat bordered').classes("w-full")

    @show_errors
    async def _on_upload(self, event: events.UploadEventArguments) -> None:
        try:
            self._context.claim_control()
            size = event.file.size()
            data = (
                await event.file.read() if size <= MAX_UPLOAD_BYTES else bytes(MAX_UPLOAD_BYTES + 1)
            )
            name = event.file.name
            inputs = self._add_options(ImportInputs(files=(Path(name),)))
            stored_name = await self._context.worker("tables").run(
                store_upload, self._context.runs, name, data, today(), inputs
            )
        finally:
            self._upload.reset()
        result = self._on_stored(stored_name)
        if isawaitable(result):
            await result

    def _on_rejected(self) -> None:
        notify_error(
            InputError(
                f"the file is no table or log, or larger than {MAX_UPLOAD_BYTES / 1e6:.0f} MB; "
                f"use another, or copy it to the runs folder"
            )
        )


# --- dialogs ------------------------------------------------------------------------------------


@contextmanager
def open_dialog(title: str) -> Iterator[ui.dialog]:
    """Open a dialog whose contents are created in the with block; it is deleted on close."""
    element = ui.dialog().props(f'aria-label="{title}"')
    with element as dialog, ui.card().classes("w-96"):
        ui.label(title).classes("card-title").props("role=heading aria-level=2")
        yield dialog
    dialog.on_value_change(lambda change: None if change.value else dialog.delete())
    dialog.open()


def confirm_arming(
    context: PageContext, parent: ui.element, text: str, start: Callable[[str, bool], object]
) -> None:
    """Open the arming dialog; a real bench needs the typed confirmation.

    Args:
        parent: element that outlives the dialog; errors are shown in its slot.
        start: called with the confirmation ("" for a simulated bench) and whether the run needs
            this page.
    """
    connection = context.bench.connection
    identity, rig = connection.identity, connection.rig
    is_simulated = identity is not None and identity.simulated
    with open_dialog("Motors will turn") as dialog:
        ui.label(text).style("white-space: pre-line")
        if identity is not None and rig is not None:
            show_warnings(identity, rig)
        typed = ui.input(f"Type {CONFIRMATION} to arm").classes("w-full")
        typed.set_visibility(not is_simulated)
        if is_simulated:
            ui.label("Simulated bench: no real motor turns.").classes("soft")
        without_page = ui.checkbox("Let it run without this page")
        ui.label("Off: motors stop if this page is closed, blocked or disconnected.").classes(
            "soft"
        )

        @show_errors
        def check_and_start() -> None:
            context.require_control()
            if not is_simulated and not typed.value.strip():
                raise InputError(f"not armed: {CONFIRMATION} was not typed; no motor was started")
            start("" if is_simulated else typed.value, not without_page.value)

        def press() -> None:
            # The dialog is deleted on close, so errors need another slot.
            with parent:
                check_and_start()
            dialog.close()

        with ui.row():
            ui.button("Start", icon="play_arrow", on_click=press)
            ui.button("Cancel", on_click=dialog.close).props("outline")


def show_warnings(identity: DeviceInfo, rig: Rig) -> None:
    """Show the command line's warnings about a bench before it is armed."""
    for warning in arming_warnings(identity, rig):
        ui.label(f"Warning: {warning}").classes("warn")
