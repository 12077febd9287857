"""The command that does the same as the page, to copy."""

from __future__ import annotations

import shlex
from collections.abc import Sequence

from nicegui import ui


class CommandRow:
    """Show a command line with a button that copies it."""

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
