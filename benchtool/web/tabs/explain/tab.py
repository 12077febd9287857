"""The Explain tab: choose recordings and a model, watch the stages, read the answer, accept it."""

from __future__ import annotations

import asyncio
from datetime import datetime
from pathlib import Path

from nicegui import app, ui

from benchtool.core.errors import BenchtoolError
from benchtool.web.context import PageContext
from benchtool.web.notifications import notify, shows_errors
from benchtool.web.progress import JobProgress
from benchtool.web.tabs.explain.answer import AnswerView
from benchtool.web.tabs.explain.sources import (
    RecordingSources,
    command_words,
    inputs_of,
    suggested_folder,
)
from benchtool.web.tabs.explain.work import EXPLANATIONS, ExplainJob, clear, start
from benchtool.web.widgets import STYLE, CommandRow, TableUpload

_STYLE = "<style>.stages { list-style: none; padding: 0; margin: 0; columns: 18rem auto; }</style>"


WHAT = (
    "Shows where recordings disagree with a model, and which physical effect the model lacks. It "
    "learns from some recordings and is checked on others of the same bench."
)


class ExplainTab:
    """Hold the form and the answer, for one page."""

    def __init__(self, context: PageContext) -> None:
        self._context = context
        self._sources = RecordingSources.of(context.runs)
        ui.add_head_html(STYLE + _STYLE)
        with ui.card().classes("w-full gap-2"):
            ui.label("Recordings and model").classes("card-title")
            ui.label(WHAT).classes("soft")
            with ui.element("div").classes("fit-form w-full"):
                with ui.column().classes("w-full gap-2"):
                    self._learn = self._recordings("Recordings to learn from", "learn")
                    self._check = self._recordings("Others to check on", "check")
                with ui.column().classes("w-full gap-2"):
                    self._model = ui.select({}, label="Model", on_change=self._changed)
                    self._model.props("use-input input-debounce=0").classes("w-full").mark("model")
                    self._model.on("popup-show", self._look)
                    TableUpload(context, self._uploaded)
            with ui.row().classes("items-center w-full gap-4"):
                self._explain = ui.button("Explain", icon="troubleshoot", on_click=self._start)
                self._explain.props("no-caps").mark("explain")
                self._hint = ui.label().classes("soft").props("role=status").mark("hint")
            with ui.element("div").classes("w-full") as self._command_place:
                self._command = CommandRow()
            self._stages = JobProgress(
                context, "explanation", self._done, self._changed, staged=True
            )
        self._answer = AnswerView(context, self._sources, self._look)
        self._changed()
        present = EXPLANATIONS.of(context.runs)
        if present is not None and present.state.running:
            self._stages.watch(present)
        elif present is not None:
            self._answer.show(present)
        query = ui.context.client.request.query_params
        names = [query.getlist(key) for key in ("learn", "check", "model")]
        ui.timer(0.0, lambda: self._begin(*names), once=True)

    @shows_errors
    async def _begin(self, learn: list[str], check: list[str], model: list[str]) -> None:
        """Offer what is there, and choose what the address names of it."""
        await self._look()
        for choice, names in ((self._learn, learn), (self._check, check)):
            choice.set_value([name for name in names if name in choice.options])
        self._model.set_value(next((name for name in model if name in self._model.options), None))

    def _recordings(self, label: str, mark: str) -> ui.select:
        choice = ui.select({}, multiple=True, label=label, on_change=self._changed)
        choice.props("use-chips use-input input-debounce=0").classes("w-full").mark(mark)
        choice.on("popup-show", self._look)
        return choice

    @shows_errors
    async def _look(self) -> None:
        """Offer what is there now."""
        found = await asyncio.to_thread(self._sources.choices)
        for choice in (self._learn, self._check):
            if choice.options != found.recordings:
                still = [name for name in choice.value or [] if name in found.recordings]
                choice.set_options(found.recordings, value=still)
        if self._model.options != found.models:
            value = self._model.value if self._model.value in found.models else None
            self._model.set_options(found.models, value=value)

    @shows_errors
    async def _uploaded(self, name: str) -> None:
        """Choose what was uploaded: first to learn from, then to check on."""
        await self._look()
        choice = self._check if self._learn.value else self._learn
        choice.set_value([*(choice.value or []), name])
        where = "to check on" if choice is self._check else "to learn from"
        notify(f"saved as {name} and chosen {where}")

    def _changed(self) -> None:
        """Show the command that the form stands for, or what it lacks."""
        try:
            inputs = inputs_of(self._sources, *self._chosen())
        except BenchtoolError as error:
            self._hint.set_text(str(error))
            self._explain.disable()
            self._command_place.set_visibility(False)
            return
        self._command_place.set_visibility(True)
        self._hint.set_text("")
        self._explain.set_enabled(not self._stages.watching)
        self._command.show(command_words(inputs, self._folder()))

    def _chosen(self) -> tuple[list[str], list[str], str]:
        return list(self._learn.value or []), list(self._check.value or []), self._model.value or ""

    def _folder(self) -> Path:
        today = f"{datetime.now().astimezone():%Y-%m-%d}"
        return suggested_folder(self._sources, self._learn.value or [], today)

    @shows_errors
    def _start(self) -> None:
        self._context.claim_control()
        inputs, out = inputs_of(self._sources, *self._chosen()), self._folder()
        self._answer.clear()
        self._stages.watch(start(self._context.runs, inputs, out, command_words(inputs, out)))
        self._changed()

    @shows_errors
    def _done(self, job: ExplainJob) -> None:
        self._answer.show(job)


def build(context: PageContext) -> None:
    """Make the tab; ?learn=NAME&check=NAME&model=NAME chooses what is asked."""
    ExplainTab(context)
    app.on_shutdown(lambda: clear(context.runs))
