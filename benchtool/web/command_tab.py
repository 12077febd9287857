"""Tab of a command that makes a report: form, equivalent command, job with progress, report."""

from __future__ import annotations

import asyncio
from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import partial
from html import escape
from typing import ClassVar

from nicegui import ui

from benchtool.core.errors import BenchtoolError
from benchtool.core.inputs import Inputs
from benchtool.data.run.runs_folder import RunsFolder
from benchtool.web.command_jobs import CommandJob, command_arguments, start_command
from benchtool.web.context import PageContext
from benchtool.web.widgets import CommandRow, show_errors

REFRESH_INTERVAL_S = 0.2


class CommandTab(ABC):
    """Tab of a command. Jobs are shared by all pages, one at a time for each `noun`.

    A subclass creates form fields in `inputs` that call `change`, then calls `add_controls` and
    `show_latest`. A report folds `inputs`, if `folds_form`.
    """

    label: ClassVar[str]
    icon: ClassVar[str]
    noun: ClassVar[str]  # of the result
    folds_form: ClassVar[bool] = True

    def __init__(self, context: PageContext) -> None:
        self.context, self.folder = context, RunsFolder(context.runs)
        self.is_ready = False
        self._job: CommandJob | None = None
        self.inputs = ui.expansion("Inputs", value=True).classes("w-full inputs")
        with ui.column().classes("w-full gap-1") as self._panel:
            with ui.row(wrap=False).classes("items-center w-full"):
                ui.spinner(size="sm")
                self._stage = ui.label().props("role=status").classes("grow")
                cancel = ui.button("Cancel", icon="close", on_click=self._cancel)
                cancel.props("outline no-wrap")
            self._bar = ui.linear_progress(show_value=False)
            self._bar.props(f'aria-label="progress of the {self.noun}"')
            self._stages = ui.html(sanitize=False)
        self._failed = ui.label().classes("warn-box w-full").props("role=alert")
        self._failed.set_visibility(False)
        self._panel.set_visibility(False)
        self.report = ui.column().classes("w-full gap-3 report scroll-place")

    @abstractmethod
    def read_form(self) -> tuple[str, Inputs]:
        """Return the name of the new folder and the inputs; raise for an invalid value."""

    @abstractmethod
    def show_report(self, job: CommandJob) -> None:
        """Show the report of a completed job in the current slot."""

    def add_controls(self) -> None:
        """Create start button, hint and equivalent command in the current slot."""
        with ui.row().classes("items-center w-full"):
            self._start = ui.button(self.label, icon=self.icon, on_click=self.start)
            self._hint = ui.label().classes("soft").props("role=status")
        with ui.element("div").classes("w-full") as self._command_container:
            self._command = CommandRow()

    def show_latest(self) -> None:
        """Show the latest job and the state of the form."""
        self.is_ready = True
        job = self.context.server.jobs.get(self.noun)
        if job is not None and not job.done():
            self._watch(job)
        elif job is not None and job.succeeded:
            self.replace_report(partial(self.show_report, job))
        self.change()
        ui.timer(REFRESH_INTERVAL_S, self._refresh)

    def change(self) -> None:
        """Show the form's command or its first error."""
        if not self.is_ready:
            return
        hint = ""
        try:
            self._command.show(command_arguments(self.read_form()[1]))
        except BenchtoolError as error:
            hint = str(error)
        self._hint.set_text(hint)
        self._command_container.set_visibility(not hint)
        self._start.set_enabled(not hint and self._job is None)

    @show_errors
    def start(self) -> None:
        """Start a job; raise if the previous one is still running."""
        self.context.claim_control()
        name, inputs = self.read_form()
        create = partial(start_command, self.folder.new_path(name), inputs)
        self._watch(self.context.server.start_job(self.noun, create))
        self.report.clear()
        self.change()

    def _watch(self, job: CommandJob) -> None:
        self._job = job
        self._failed.set_visibility(False)
        self._show_progress(job)

    async def done(self, job: CommandJob) -> None:
        """Show the report of a job that was completed while the page was open."""
        self.replace_report(partial(self.show_report, job))
        self.report.run_method("scrollIntoView", {"behavior": "smooth", "block": "start"})

    def replace_report(self, show: Callable[[], object]) -> None:
        """Replace the report by what `show` creates, and fold the form."""
        self.inputs.set_value(not self.folds_form)
        self.report.clear()
        with self.report:
            show()

    @show_errors
    async def _refresh(self) -> None:
        if (job := self._job) is None:
            return
        self._show_progress(job)
        if not job.done():
            return
        self._job = None
        self._panel.set_visibility(False)
        self.change()
        if job.succeeded:
            await self.done(job)
            return
        cancelled_text = f"{job.out.name} was cancelled; nothing was written"
        self._failed.set_text(cancelled_text if job.cancelled() else str(job.exception()))
        self._failed.set_visibility(True)

    def _show_progress(self, job: CommandJob) -> None:
        self._panel.set_visibility(True)
        self._stage.set_text(f"{job.out.name}: {job.stage}, {100.0 * job.share:.0f} %")
        self._bar.set_value(job.share)
        items = [f"<li>✓ {escape(stage)}</li>" for stage in job.stages[:-1]]
        items += [f"<li><b>… {escape(stage)}</b></li>" for stage in job.stages[-1:]]
        self._stages.set_content(f'<ol class="stages">{"".join(items)}</ol>')

    @show_errors
    async def _cancel(self) -> None:
        self.context.claim_control()
        if self._job is not None:
            await asyncio.to_thread(self._job.cancel)
