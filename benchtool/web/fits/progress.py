"""How a fit stands, on the page: its stage, how far it is, cancel, why it failed."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

from nicegui import ui

from benchtool.web.context import Context
from benchtool.web.fits.running import Fitting, cancel, latest
from benchtool.web.tell import tells_errors

LOOK_S = 0.25


class Progress:
    """Show the fit that runs, and tell when one is done.

    Args:
        context: of the page.
        done: called with a fit that has ended well while the page was there.
    """

    def __init__(self, context: Context, done: Callable[[Fitting], Awaitable[None]]) -> None:
        self._context, self._done = context, done
        self._watched: Fitting | None = None
        with ui.row().classes("items-center w-full gap-4") as self._row:
            ui.spinner(size="sm")
            self._what = ui.label().props("role=status").mark("stage")
            self._bar = ui.linear_progress(show_value=False).classes("grow")
            self._bar.props('aria-label="how far the fit is"')
            ui.button("Cancel", icon="close", on_click=self._cancel).props("outline no-caps")
        self._failed = ui.label().classes("warn-box w-full").props("role=alert").mark("failed")
        self._failed.set_visibility(False)
        present = latest(context.runs)
        if present is not None and present.state.running:
            self._watched = present
        self._row.set_visibility(self._watched is not None)
        ui.timer(LOOK_S, self.look)

    def watch(self, fitting: Fitting) -> None:
        """Show another fit."""
        self._watched = fitting
        self._failed.set_visibility(False)

    async def look(self) -> None:
        """Show how it stands now."""
        fitting = self._watched
        self._row.set_visibility(fitting is not None)
        if fitting is None:
            return
        state = fitting.state
        share = f" {100.0 * state.share:.0f} %" if state.share > 0.0 else ""
        self._what.set_text(f"{fitting.out.name}: {state.what}{share}")
        self._bar.set_value(state.share)
        if state.running:
            return
        self._watched = None
        self._row.set_visibility(False)
        if state.status == "done":
            await self._done(fitting)
            return
        said = {"cancelled": f"{fitting.out.name} was cancelled; nothing was kept of it"}
        self._failed.set_text(said.get(state.status, state.error))
        self._failed.set_visibility(True)

    @tells_errors
    async def _cancel(self) -> None:
        self._context.need_pen()
        if self._watched is not None:
            await asyncio.to_thread(cancel, self._watched)
