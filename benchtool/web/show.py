"""Put what a process of its own has made ready onto the page."""

from __future__ import annotations

from nicegui import ui

from benchtool.web.command_row import CommandRow
from benchtool.web.shown import Piece, Shown

STYLE = '<link rel="stylesheet" href="/static/shown.css">'


def show(shown: Shown, *, headed: bool = True) -> None:
    """Make the elements of what is shown in the present slot.

    Args:
        shown: what.
        headed: with its title and its command.
    """
    with ui.element("div").classes("shown-body").mark("shown"):
        if headed:
            with ui.row().classes("items-center gap-3"):
                ui.label(shown.title).classes("card-title")
                if shown.simulated:
                    ui.label("SIMULATED").classes("stamp")
            if shown.command:
                CommandRow(shown.command)
        for piece in shown.pieces:
            show_piece(piece)


def show_piece(piece: Piece) -> None:
    """Make the element of one piece in the present slot."""
    made = ui.html(piece.html, sanitize=False)
    made.classes("block-beside" if piece.beside else "w-full")


def waiting(what: str) -> None:
    """Say that something is being made ready, in the present slot."""
    with ui.row().classes("items-center").props("role=status"):
        ui.spinner(size="sm")
        ui.label(what).classes("soft")
