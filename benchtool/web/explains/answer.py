"""What was found, on the page: the sentence, accept it, where, which, the gap, what is next."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from html import escape
from pathlib import Path
from urllib.parse import urlencode

from nicegui import run, ui

from benchtool.web.command_row import CommandRow
from benchtool.web.context import Context
from benchtool.web.explains.places import Places
from benchtool.web.explains.running import Explaining
from benchtool.web.explains.work import Explained
from benchtool.web.show import show
from benchtool.web.shown import Shown
from benchtool.web.tell import tells_errors

OPEN = ("What now", "Where", "Which", "The gap")
"""Sections of the report that are shown; the others can be opened."""


class AnswerView:
    """Show an answer and let it be accepted.

    Args:
        context: of the page.
        places: where recordings and models are.
        kept: called when the answer has been written.
    """

    def __init__(
        self, context: Context, places: Places, kept: Callable[[], Awaitable[None]]
    ) -> None:
        self._context, self._places, self._kept = context, places, kept
        self._place = ui.column().classes("w-full gap-3 scroll-place")

    def clear(self) -> None:
        """Take an earlier answer away."""
        self._place.clear()

    def show(self, explaining: Explaining) -> None:
        """Show what an explanation found."""
        found = explaining.state.result
        if found is None:
            return
        self.clear()
        with self._place:
            with ui.card().classes("w-full gap-2"):
                self._head(explaining, found)
            for part in found.parts:
                if part.title in OPEN:
                    with ui.card().classes("w-full"):
                        show(part)
            with ui.card().classes("w-full"):
                for part in found.parts:
                    if part.title not in OPEN:
                        _folded(part)
        self._place.run_method("scrollIntoView", {"behavior": "smooth", "block": "start"})

    def _head(self, explaining: Explaining, found: Explained) -> None:
        with ui.row().classes("items-center gap-3"):
            ui.label("Answer").classes("card-title")
            if found.simulated:
                ui.label("SIMULATED").classes("stamp")
            ui.label(f"after {found.seconds:.1f} s").classes("soft")
        ui.label(found.sentence).classes("text-h6").props("role=status").mark("verdict")
        show(Shown(title="", pieces=found.highlights), headed=False)
        CommandRow(explaining.words)
        with ui.row().classes("items-center gap-4 w-full"):
            words = f"Accept {' and '.join(found.named)} into a new model"
            button = ui.button(words if found.named else "Keep this answer", icon="check")
            button.props("no-caps").mark("accept")
            said = ui.html(_said(self._places, explaining, found), sanitize=False)
            said.props("role=status").mark("accepted")

        @tells_errors
        async def accept() -> None:
            self._context.need_pen()
            button.disable()
            try:
                await run.io_bound(explaining.keep, _free(explaining.out))
            finally:
                button.set_enabled(explaining.kept is None)
            said.set_content(_said(self._places, explaining, found))
            await self._kept()

        button.on_click(accept)
        button.set_enabled(explaining.kept is None)


def _said(places: Places, explaining: Explaining, found: Explained) -> str:
    """Say what accepting does, or what it has done."""
    name = escape(explaining.out.name)
    if explaining.kept is None:
        what = "model.toml, the report and the figures" if found.named else "report and figures"
        return f'<span class="soft">writes {what} to {escape(str(explaining.out))}</span>'
    address = "?" + urlencode({"tab": "runs", "run": places.runs.name_of(explaining.out)})
    link = f'<a href="{escape(address)}">{name}</a>'
    if not explaining.kept:
        return f"kept as {link}"
    return (
        f"the model <b>{escape(explaining.kept)}</b> was written to {link}; it can be chosen above"
    )


def _free(out: Path) -> Path:
    """Return the folder, or the next number behind its name where it was taken meanwhile."""
    count, free = 1, out
    while free.exists():
        count += 1
        free = out.with_name(f"{out.name}-{count}")
    return free


def _folded(part: Shown) -> None:
    with ui.expansion(part.title).classes("w-full").props("dense"):
        show(part, headed=False)
