"""How long work stands, on the page: its stages, how far it is, cancel, why it failed."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from html import escape
from inspect import isawaitable
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

from nicegui import ui

from benchtool.web.context import Context
from benchtool.web.job import JobState
from benchtool.web.tell import tells_errors

LOOK_S = 0.2


class Work(Protocol):
    """Work that was started and makes a folder."""

    @property
    def out(self) -> Path:
        """Its folder, there once it is kept."""

    @property
    def state(self) -> JobState[Any]:
        """How it stands."""

    def cancel(self) -> None:
        """End it and take away what it had begun to write."""


W = TypeVar("W", bound=Work)


class Progress(Generic[W]):
    """Show the work that runs, and tell when it is done.

    Args:
        context: of the page.
        what: is done, in one word ("fit").
        done: called with work that has ended well while the page was there.
        ended: called whenever some has ended, however.
        staged: list the stages, not only the present one.
    """

    def __init__(
        self,
        context: Context,
        what: str,
        done: Callable[[W], Awaitable[None] | None],
        ended: Callable[[], object] = lambda: None,
        *,
        staged: bool = False,
    ) -> None:
        self._context, self._done, self._ended = context, done, ended
        self._watched: W | None = None
        with ui.column().classes("w-full gap-1") as self._place:
            with ui.row(wrap=False).classes("items-center w-full gap-4"):
                ui.spinner(size="sm")
                self._what = (
                    ui.label().props("role=status").classes("whitespace-nowrap").mark("stage")
                )
                self._bar = ui.linear_progress(show_value=False).classes("grow")
                self._bar.props(f'aria-label="how far the {what} is"')
                cancel = ui.button("Cancel", icon="close", on_click=self._cancel)
                cancel.props("outline no-caps no-wrap")
            self._list = ui.html(sanitize=False).mark("stages")
        self._list.set_visibility(staged)
        self._failed = ui.label().classes("warn-box w-full").props("role=alert").mark("failed")
        self._failed.set_visibility(False)
        self._place.set_visibility(False)
        ui.timer(LOOK_S, self.look)

    @property
    def watching(self) -> bool:
        """Whether something runs."""
        return self._watched is not None

    def watch(self, work: W) -> None:
        """Show other work."""
        self._watched = work
        self._failed.set_visibility(False)
        self._show(work)

    async def look(self) -> None:
        """Show how it stands now."""
        work = self._watched
        if work is None:
            return
        self._show(work)
        state = work.state
        if state.running:
            return
        self._watched = None
        self._place.set_visibility(False)
        self._ended()
        if state.status == "done":
            told = self._done(work)
            if isawaitable(told):
                await told
            return
        cancelled = f"{work.out.name} was cancelled; nothing was kept of it"
        self._failed.set_text(cancelled if state.status == "cancelled" else state.error)
        self._failed.set_visibility(True)

    def _show(self, work: W) -> None:
        state = work.state
        self._place.set_visibility(True)
        self._what.set_text(f"{work.out.name}: {state.what}, {100.0 * state.share:.0f} %")
        self._bar.set_value(state.share)
        self._list.set_content(_stages(state.stages))

    @tells_errors
    async def _cancel(self) -> None:
        self._context.need_pen()
        if self._watched is not None:
            await asyncio.to_thread(self._watched.cancel)


def _stages(stages: tuple[str, ...]) -> str:
    """List what was done, and what is being done at the end."""
    done = [f"<li>✓ {escape(stage)}</li>" for stage in stages[:-1]]
    now = [f"<li><b>… {escape(stage)}</b></li>" for stage in stages[-1:]]
    return f'<ol class="stages">{"".join(done + now)}</ol>'
