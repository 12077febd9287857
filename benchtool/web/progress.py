"""Progress display of a job with stages, cancel button and error."""

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
    """Progress display of the running job of a kind, started on any page.

    Args:
        on_done: called with a job that was completed while the page was open.
        on_end: called after every end, before `on_done`.
    """

    def __init__(
        self,
        context: PageContext,
        kind: str,
        noun: str,
        on_done: Callable[[J], Awaitable[None] | None],
        on_end: Callable[[], object] = lambda: None,
        *,
        has_stages: bool = False,
    ) -> None:
        self._context, self._kind, self._on_done, self._on_end = context, kind, on_done, on_end
        self._job: J | None = None
        with ui.column().classes("w-full gap-1") as self._panel:
            with ui.row(wrap=False).classes("items-center w-full gap-4"):
                ui.spinner(size="sm")
                self._stage = ui.label().props("role=status").classes("whitespace-nowrap")
                self._bar = ui.linear_progress(show_value=False).classes("grow")
                self._bar.props(f'aria-label="progress of the {noun}"')
                cancel = ui.button("Cancel", icon="close", on_click=self._cancel)
                cancel.props("outline no-caps no-wrap")
            self._list = ui.html(sanitize=False)
        self._list.set_visibility(has_stages)
        self._failed = ui.label().classes("warn-box w-full").props("role=alert")
        self._failed.set_visibility(False)
        self._panel.set_visibility(False)
        if (latest := self.latest) is not None and latest.state.running:
            self._watch(latest)
        ui.timer(REFRESH_INTERVAL_S, self.refresh)

    @property
    def latest(self) -> J | None:
        return self._context.server.jobs.get(self._kind)  # type: ignore[return-value]

    @property
    def is_watching(self) -> bool:
        return self._job is not None

    def start(self, create: Callable[[], J]) -> None:
        """Start a job and display it; raise if the previous one is still running."""
        self._watch(self._context.server.start_job(self._kind, create))

    def _watch(self, job: J) -> None:
        self._job = job
        self._failed.set_visibility(False)
        self._show(job)

    async def refresh(self) -> None:
        job = self._job
        if job is None:
            return
        self._show(job)
        state = job.state
        if state.running:
            return
        self._job = None
        self._panel.set_visibility(False)
        self._on_end()
        if state.status == "done":
            result = self._on_done(job)
            if isawaitable(result):
                await result
            return
        cancelled_text = f"{job.out.name} was cancelled; nothing was written"
        self._failed.set_text(cancelled_text if state.status == "cancelled" else state.error)
        self._failed.set_visibility(True)

    def _show(self, job: J) -> None:
        state = job.state
        self._panel.set_visibility(True)
        self._stage.set_text(f"{job.out.name}: {state.stage}, {100.0 * state.share:.0f} %")
        self._bar.set_value(state.share)
        items = [f"<li>✓ {escape(stage)}</li>" for stage in state.stages[:-1]]
        items += [f"<li><b>… {escape(stage)}</b></li>" for stage in state.stages[-1:]]
        self._list.set_content(f'<ol class="stages">{"".join(items)}</ol>')

    @show_errors
    async def _cancel(self) -> None:
        self._context.claim_control()
        if self._job is not None:
            await asyncio.to_thread(self._job.cancel)
