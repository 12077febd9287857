"""Shared widgets: notifications, command rows, uploads and the arming dialog."""

from __future__ import annotations

import asyncio
import shlex
from collections.abc import Awaitable, Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import datetime
from functools import wraps
from inspect import iscoroutinefunction
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlencode

from nicegui import Client, events, ui

from benchtool.acquire.check_plan import check_plan
from benchtool.acquire.inputs import RecordInputs, SweepInputs
from benchtool.acquire.operator import CONFIRMATION, arming_prompt, arming_warnings
from benchtool.acquire.resume import load_resume_state
from benchtool.bench.bench import DeviceInfo
from benchtool.core.errors import BenchtoolError, InputError
from benchtool.core.rig import Rig
from benchtool.core.text import pluralize
from benchtool.data.run.run import Run
from benchtool.data.run.runs_folder import MAX_UPLOAD_BYTES
from benchtool.tasks import to_user_error
from benchtool.web.bench_process.messages import Notice, StartRun
from benchtool.web.context import PageContext
from benchtool.web.drawing import PageSection
from benchtool.web.sockets import PAGES

if TYPE_CHECKING:
    from benchtool.commands.import_file import ImportInputs


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


NOTE_MS = 6000  # display time of a notification; the message history has all; assumed


def notify(text: str, *, logged: bool = False) -> None:
    """Show a notification and log it, unless already logged."""
    if not logged:
        log_message(text)
    ui.notify(text, type="info", position="bottom-left", timeout=NOTE_MS)


def notify_error(error: Exception, *, logged: bool = False) -> None:
    """Show an error notification with the message of the command line."""
    text = str(to_user_error(error))
    if not logged:
        log_message(text, is_error=True)
    ui.notify(
        text,
        type="negative", position="bottom-left", multi_line=True,
        timeout=NOTE_MS, close_button="Close",
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


@contextmanager
def _errors_shown() -> Iterator[None]:
    page = ui.context.client
    try:
        yield
    except Exception as error:  # noqa: BLE001 -- the boundary where errors are shown
        # In the page's slot: the card of the handler may have been deleted.
        with page:
            notify_error(error)


def show_errors(handler: Callable[..., Any]) -> Callable[..., Any]:
    """Wrap a handler so that its errors are shown as notifications."""
    if not iscoroutinefunction(handler):
        return _errors_shown()(handler)

    @wraps(handler)
    async def run(*args: Any, **kwargs: Any) -> Any:
        with _errors_shown():
            return await handler(*args, **kwargs)

    return run


# --- elements -----------------------------------------------------------------------------------


@contextmanager
def titled_card(title: str) -> Iterator[ui.card]:
    """Create a card with a title in the current slot."""
    with ui.card().classes("w-full") as card:
        ui.label(title).classes("card-title").props("role=heading aria-level=2")
        yield card


def refresh_cards(interval_s: float, *cards: Any) -> None:
    """Refresh cards now and periodically."""

    def refresh() -> None:
        for card in cards:
            card.refresh()

    refresh()
    ui.timer(interval_s, refresh)


def show_facts(container: ui.element, facts: Mapping[str, str]) -> None:
    """Show names and texts as labels; with unchanged names, only the texts are sent."""
    labels: list[Any] = container.default_slot.children
    if [label.text for label in labels[::2]] != list(facts):
        container.clear()
        with container:
            labels = [ui.label(text) for pair in facts.items() for text in pair]
    for label, text in zip(labels[1::2], facts.values(), strict=True):
        label.set_text(text)


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


def show_title(section: PageSection, subtitle: str = "") -> None:
    """Show the title of a section."""
    with ui.row().classes("items-center gap-3"):
        ui.label(section.title).classes("card-title")
        if subtitle:
            ui.label(subtitle).classes("soft")
        if section.simulated:
            ui.label("SIMULATED").classes("stamp")


def show_section(section: PageSection) -> None:
    """Show a section, its details as expansions, and its command."""
    show_html(section)
    if details := [detail for detail in section.details if detail.html]:
        with ui.element("div").classes("w-full details"):
            for detail in details:
                with ui.expansion(detail.title):
                    show_html(detail)
    if section.command:
        CommandRow(section.command)


def show_html(section: PageSection) -> None:
    """Show the contents of a section."""
    ui.html(section.html, sanitize=False).classes("shown-body")


def show_spinner(text: str) -> None:
    """Show a spinner with a text in the current slot."""
    with ui.row().classes("items-center").props("role=status"):
        ui.spinner(size="sm")
        ui.label(text).classes("soft")


def add_section_expansion(
    title: str, load: Callable[[], Awaitable[PageSection]], text: str
) -> ui.expansion:
    """Create an expansion whose section is loaded when it is opened; `text` is shown meanwhile."""
    with ui.expansion(title).classes("w-full") as expansion:
        container = ui.column().classes("w-full")

    async def fill() -> None:
        if expansion.value and not container.default_slot.children:
            await load_section(container, load, text)

    return expansion.on_value_change(fill)


@show_errors
async def load_section(
    container: ui.element, load: Callable[[], Awaitable[PageSection]], text: str
) -> None:
    """Replace the contents of a container by a section; `text` is shown meanwhile."""
    container.clear()
    with container:
        show_spinner(text)
    try:
        section = await load()
    finally:
        container.clear()
    with container:
        show_section(section)


def multiple_choice(label: str, on_change: Callable[[], object]) -> ui.select:
    """Create a searchable select with multiple choice."""
    select = ui.select({}, multiple=True, label=label, on_change=on_change)
    return select.props("use-chips use-input input-debounce=0").classes("w-full")


def replace_options(select: ui.select, options: list[str] | dict[str, str]) -> None:
    """Replace the options of a select if they have changed; selected ones that remain are kept."""
    if options != select.options:
        selected = select.value or [] if select.multiple else [select.value]
        values = [value for value in selected if value in options]
        select.set_options(options, value=values if select.multiple else next(iter(values), None))


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


def add_table_upload(
    context: PageContext,
    on_stored: Callable[[str], Awaitable[None]],
    add_options: Callable[[ImportInputs], ImportInputs] = lambda inputs: inputs,
) -> None:
    """Create an upload of untrusted tables and logs into the runs folder.

    `on_stored` is called with the name of each file in the folder.
    """
    from benchtool.commands.import_file import ImportInputs
    from benchtool.web.entries import store_upload

    @show_errors
    async def store(event: events.UploadEventArguments) -> None:
        try:
            context.claim_control()
            name, is_too_large = event.file.name, event.file.size() > MAX_UPLOAD_BYTES
            data = bytes(MAX_UPLOAD_BYTES + 1) if is_too_large else await event.file.read()
            inputs = add_options(ImportInputs(files=(Path(name),)))
            stored_name = await context.compute("tables", store_upload, name, data, today(), inputs)
        finally:
            upload.reset()
        await on_stored(stored_name)

    def reject() -> None:
        notify_error(
            InputError(
                f"the file is no table or log, or larger than {MAX_UPLOAD_BYTES / 1e6:.0f} MB; "
                f"use another, or copy it to the runs folder"
            )
        )

    upload = file_upload(
        "Upload a CSV file or a log",
        max_file_size=MAX_UPLOAD_BYTES,
        on_upload=store,
        on_rejected=reject,
    )
    upload.props(f'accept="{UPLOAD_TYPES}" flat bordered').classes("w-full")


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


@show_errors
async def confirm_resume(context: PageContext, parent: ui.element, path: Path) -> None:
    """Open the arming dialog for the remaining points of a stopped sweep."""
    context.require_control()
    if (identity := context.bench.connection.identity) is None:
        raise InputError("no bench is connected; connect the bench of the sweep under Bench")
    state = await asyncio.to_thread(load_resume_state, Run.open(path))
    expected = check_plan(state.plan, state.rig, identity.limits)
    text = f"{path.name}: {pluralize(state.remaining, 'point')} remaining\n"
    text += arming_prompt(state.plan, state.rig, expected)
    with parent:
        confirm_arming(context, parent, text, SweepInputs(runs=context.runs, resume=path))


def confirm_arming(
    context: PageContext, parent: ui.element, text: str, inputs: SweepInputs | RecordInputs
) -> None:
    """Open the arming dialog, which starts a run; a real bench needs the typed confirmation.

    Errors are shown in the slot of `parent`, which outlives the dialog.
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
            confirmation = "" if is_simulated else typed.value
            context.bench.send(StartRun(inputs, confirmation, not without_page.value))
            if isinstance(inputs, SweepInputs):  # scroll up to the progress
                ui.run_javascript("window.scrollTo({top: 0, behavior: 'smooth'})")

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
