"""How an explanation stands, on the page: its stages, how far it is, cancel, why it failed."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from html import escape

from nicegui import ui

from benchtool.web.context import Context
from benchtool.web.explains.running import Explaining
from benchtool.web.tell import tells_errors

LOOK_S = 0.2


class Stages:
    """Show the explanation that runs, and tell when it is done.

    Args:
        context: of the page.
        done: called with an explanation that has ended well.
        ended: called whenever one has ended, however.
    """

    def __init__(
        self, context: Context, done: Callable[[Explaining], object], ended: Callable[[], object]
    ) -> None:
        self._context, self._done, self._ended = context, done, ended
        self._watched: Explaining | None = None
        with ui.column().classes("w-full gap-1") as self._place:
            with ui.row(wrap=False).classes("items-center w-full gap-4"):
                ui.spinner(size="sm")
                self._what = (
                    ui.label().props("role=status").classes("whitespace-nowrap").mark("stage")
                )
                self._bar = ui.linear_progress(show_value=False).classes("grow")
                self._bar.props('aria-label="how far the explanation is"')
                cancel = ui.button("Cancel", icon="close", on_click=self._cancel)
                cancel.props("outline no-caps no-wrap")
            self._list = ui.html(sanitize=False).mark("stages")
        self._failed = ui.label().classes("warn-box w-full").props("role=alert").mark("failed")
        self._failed.set_visibility(False)
        self._place.set_visibility(False)
        ui.timer(LOOK_S, self.look)

    @property
    def watching(self) -> bool:
        """Whether one runs."""
        return self._watched is not None

    def watch(self, explaining: Explaining) -> None:
        """Show another explanation."""
        self._watched = explaining
        self._failed.set_visibility(False)
        self.look()

    def look(self) -> None:
        """Show how it stands now."""
        explaining = self._watched
        self._place.set_visibility(explaining is not None)
        if explaining is None:
            return
        state = explaining.state
        self._what.set_text(f"{state.what}, {100.0 * state.share:.0f} %")
        self._bar.set_value(state.share)
        self._list.set_content(_stages(state.stages))
        if state.running:
            return
        self._watched = None
        self._place.set_visibility(False)
        self._ended()
        if state.status == "done":
            self._done(explaining)
            return
        said = {"cancelled": "cancelled; nothing was kept of it"}
        self._failed.set_text(said.get(state.status, state.error))
        self._failed.set_visibility(True)

    @tells_errors
    async def _cancel(self) -> None:
        self._context.need_pen()
        if self._watched is not None:
            await asyncio.to_thread(self._watched.cancel)
        self.look()


def _stages(stages: tuple[str, ...]) -> str:
    """List what was done, and what is being done at the end."""
    done = [f"<li>✓ {escape(stage)}</li>" for stage in stages[:-1]]
    now = [f"<li><b>… {escape(stage)}</b></li>" for stage in stages[-1:]]
    return f'<ol class="stages">{"".join(done + now)}</ol>'
