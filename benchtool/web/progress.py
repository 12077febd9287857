"""A job on the page: its stages, how far it is, cancel, why it failed."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from html import escape
from inspect import isawaitable
from typing import Generic

from nicegui import ui

from benchtool.web.context import J, PageContext
from benchtool.web.widgets import show_errors

REFRESH_INTERVAL_S = 0.2


class JobProgress(Generic[J]):
    """Show the job that runs, one begun on another page too, and call back when it has ended.

    Args:
        done: called with a job that has ended well while the page was there.
        ended: called whenever one has ended, however.
    """

    def __init__(
        self,
        context: PageContext,
        kind: str,
        what: str,
        done: Callable[[J], Awaitable[None] | None],
        ended: Callable[[], object] = lambda: None,
        *,
        staged: bool = False,
    ) -> None:
        self._context, self._kind, self._done, self._ended = context, kind, done, ended
        self._job: J | None = None
        with ui.column().classes("w-full gap-1") as self._place:
            with ui.row(wrap=False).classes("items-center w-full gap-4"):
                ui.spinner(size="sm")
                self._what = ui.label().props("role=status").classes("whitespace-nowrap")
                self._bar = ui.linear_progress(show_value=False).classes("grow")
                self._bar.props(f'aria-label="how far the {what} is"')
                cancel = ui.button("Cancel", icon="close", on_click=self._cancel)
                cancel.props("outline no-caps no-wrap")
            self._list = ui.html(sanitize=False)
        self._list.set_visibility(staged)
        self._failed = ui.label().classes("warn-box w-full").props("role=alert")
        self._failed.set_visibility(False)
        self._place.set_visibility(False)
        if (latest := self.latest) is not None and latest.state.running:
            self._watch(latest)
        ui.timer(REFRESH_INTERVAL_S, self.look)

    @property
    def latest(self) -> J | None:
        return self._context.server.jobs.get(self._kind)  # type: ignore[return-value]

    @property
    def watching(self) -> bool:
        return self._job is not None

    def start(self, begin: Callable[[], J]) -> None:
        """Start a job and show it.

        Raises:
            InputError: the one before still runs.
        """
        self._watch(self._context.server.start_job(self._kind, begin))

    def _watch(self, job: J) -> None:
        self._job = job
        self._failed.set_visibility(False)
        self._show(job)

    async def look(self) -> None:
        job = self._job
        if job is None:
            return
        self._show(job)
        state = job.state
        if state.running:
            return
        self._job = None
        self._place.set_visibility(False)
        self._ended()
        if state.status == "done":
            following = self._done(job)
            if isawaitable(following):
                await following
            return
        cancelled = f"{job.out.name} was cancelled; nothing was written"
        self._failed.set_text(cancelled if state.status == "cancelled" else state.error)
        self._failed.set_visibility(True)

    def _show(self, job: J) -> None:
        state = job.state
        self._place.set_visibility(True)
        self._what.set_text(f"{job.out.name}: {state.what}, {100.0 * state.share:.0f} %")
        self._bar.set_value(state.share)
        done = [f"<li>✓ {escape(stage)}</li>" for stage in state.stages[:-1]]
        now = [f"<li><b>… {escape(stage)}</b></li>" for stage in state.stages[-1:]]
        self._list.set_content(f'<ol class="stages">{"".join(done + now)}</ol>')

    @show_errors
    async def _cancel(self) -> None:
        self._context.claim_control()
        if self._job is not None:
            await asyncio.to_thread(self._job.cancel)
