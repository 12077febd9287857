"""Ask before motors turn: what will spin, and the typed word unless the bench is simulated."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import ui

from benchtool.acquire.arming import CONFIRMATION, arming_warnings
from benchtool.bench.bench import Identity
from benchtool.core.errors import InputError
from benchtool.core.rig import Rig
from benchtool.web.context import PageContext
from benchtool.web.notifications import shows_errors


def confirm_arming(
    context: PageContext, place: ui.element, text: str, begin: Callable[[str], object]
) -> None:
    """Show what will spin.

    Args:
        context: of the page.
        place: what stays when the dialog is gone; errors are shown there.
        text: what the operator must know.
        begin: called with what was typed, empty on a simulated bench.
    """
    connection = context.bench.connection
    identity, rig = connection.identity, connection.rig
    simulated = identity is not None and identity.simulated
    with ui.dialog() as dialog, ui.card().classes("w-96"):
        ui.label("About to spin").classes("card-title")
        ui.label(text).style("white-space: pre-line")
        if identity is not None and rig is not None:
            show_warnings(identity, rig)
        typed = ui.input(f"Type {CONFIRMATION} to arm").classes("w-full")
        typed.set_visibility(not simulated)
        if simulated:
            ui.label("A simulated bench: no motor turns.").classes("soft")

        @shows_errors
        def confirmed() -> None:
            context.require_control()
            if not simulated and not typed.value.strip():
                raise InputError(f"not armed: {CONFIRMATION} was not typed; nothing was spun")
            begin("" if simulated else typed.value)

        def press() -> None:
            # In a place that stays: a dialog that is closed is gone with all that is in it.
            with place:
                confirmed()
            dialog.close()

        with ui.row():
            ui.button("Start", icon="play_arrow", on_click=press)
            ui.button("Cancel", on_click=dialog.close).props("outline")
    dialog.on_value_change(lambda change: None if change.value else dialog.delete())
    dialog.open()


def show_warnings(identity: Identity, rig: Rig) -> None:
    """Show what the command line, too, says of a bench before it is armed."""
    for warning in arming_warnings(identity, rig):
        ui.label(f"Warning: {warning}").classes("warn")
