"""The Explain tab: choose recordings and a model, watch the stages, read the answer, accept it."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from html import escape
from pathlib import Path
from urllib.parse import urlencode

from nicegui import run, ui

from benchtool.core.errors import BenchtoolError
from benchtool.data.run.run import free_path
from benchtool.web.context import PageContext
from benchtool.web.progress import JobProgress
from benchtool.web.tabs.explain.sources import (
    RecordingSources,
    command_words,
    explain_inputs,
    suggested_folder,
)
from benchtool.web.tabs.explain.work import ExplainJob, ExplanationResult, explain
from benchtool.web.tabs.fit.model_choice import rig_choices
from benchtool.web.widgets import (
    STYLE,
    CommandRow,
    TableUpload,
    multiple_choice,
    notify,
    show_errors,
    show_section,
    show_stamp,
    today,
)

_STYLE = "<style>.stages { list-style: none; padding: 0; margin: 0; columns: 18rem auto; }</style>"

WHAT = (
    "Shows where recordings disagree with a model, and which physical effect the model lacks. It "
    "learns from some recordings and is checked on others of the same bench."
)

OPEN = ("What now", "Where", "Which", "The gap")  # sections that are open at first


class AnswerView:
    """Show an answer and let it be accepted."""

    def __init__(
        self,
        context: PageContext,
        sources: RecordingSources,
        written: Callable[[], Awaitable[None]],
    ) -> None:
        self._context, self._sources, self._written = context, sources, written
        self._place = ui.column().classes("w-full gap-3 scroll-place")

    def clear(self) -> None:
        self._place.clear()

    def show(self, job: ExplainJob) -> None:
        found = job.state.result
        if found is None:
            return
        self.clear()
        with self._place:
            with ui.card().classes("w-full gap-2"):
                self._head(job, found)
            for part in found.parts:
                if part.title in OPEN:
                    with ui.card().classes("w-full"):
                        show_section(part)
            with ui.card().classes("w-full"):
                for part in found.parts:
                    if part.title not in OPEN:
                        with ui.expansion(part.title).classes("w-full").props("dense"):
                            show_section(part, headed=False)
        self._place.run_method("scrollIntoView", {"behavior": "smooth", "block": "start"})

    def _head(self, job: ExplainJob, found: ExplanationResult) -> None:
        with ui.row().classes("items-center gap-3"):
            ui.label("Answer").classes("card-title")
            show_stamp(found.simulated)
            ui.label(f"after {found.seconds:.1f} s").classes("soft")
        ui.label(found.sentence).classes("text-h6").props("role=status")
        ui.html(found.highlights, sanitize=False).classes("shown-body")
        CommandRow(job.words)
        with ui.row().classes("items-center gap-4 w-full"):
            words = f"Accept {' and '.join(found.named)} into a new model"
            button = ui.button(words if found.named else "Save this answer", icon="check")
            status = ui.html(self._status(job, found), sanitize=False).props("role=status")

        @show_errors
        async def accept() -> None:
            self._context.claim_control()
            button.disable()
            try:
                # Another number behind its name where it was taken meanwhile.
                await run.io_bound(job.accept, free_path(job.out))
            finally:
                button.set_enabled(job.accepted is None)
            status.set_content(self._status(job, found))
            await self._written()

        button.on_click(accept)
        button.set_enabled(job.accepted is None)

    def _status(self, job: ExplainJob, found: ExplanationResult) -> str:
        """Return what accepting does, or what it has done, as HTML."""
        if job.accepted is None:
            what = "model.toml, the report and the figures" if found.named else "report and figures"
            return f'<span class="soft">writes {what} to {escape(str(job.out))}</span>'
        address = "?" + urlencode({"tab": "runs", "run": self._sources.runs.name_of(job.out)})
        link = f'<a href="{escape(address)}">{escape(job.out.name)}</a>'
        if not job.accepted:
            return f"saved as {link}"
        model = escape(job.accepted)
        return f"the model <b>{model}</b> was written to {link}; it can be chosen above"


class ExplainTab:
    """Hold the form and the answer, for one page."""

    def __init__(self, context: PageContext) -> None:
        self._context = context
        self._proposed = ""
        self._sources = RecordingSources.of(context.runs)
        ui.add_head_html(STYLE + _STYLE)
        with ui.card().classes("w-full gap-2"):
            ui.label("Recordings and model").classes("card-title")
            ui.label(WHAT).classes("soft")
            with ui.element("div").classes("fit-form w-full"):
                with ui.column().classes("w-full gap-2"):
                    self._learn = multiple_choice("Recordings to learn from", self._propose)
                    self._check = multiple_choice("Others to check on", self._changed)
                with ui.column().classes("w-full gap-2"):
                    self._model = ui.select({}, label="Model", on_change=self._changed)
                    self._model.props("use-input input-debounce=0").classes("w-full")
                    rigs = rig_choices(self._sources.runs)
                    self._rig = ui.select(rigs, label="Rig of a table", on_change=self._changed)
                    self._rig.props("clearable").classes("w-full")
                    TableUpload(context, self._uploaded)
            for choice in (self._learn, self._check, self._model):
                choice.on("popup-show", self._look)
            with ui.row().classes("items-center w-full gap-4"):
                self._explain = ui.button("Explain", icon="troubleshoot", on_click=self._start)
                self._hint = ui.label().classes("soft").props("role=status")
            with ui.element("div").classes("w-full") as self._command_place:
                self._command = CommandRow()
            self._stages: JobProgress[ExplainJob] = JobProgress(
                context, "explanations", "explanation", self._done, self._changed, staged=True
            )
        self._answer = AnswerView(context, self._sources, self._look)
        self._changed()
        if self._stages.latest is not None:
            self._answer.show(self._stages.latest)
        query = ui.context.client.request.query_params
        names = [query.getlist(key) for key in ("learn", "check", "model")]
        ui.timer(0.0, lambda: self._begin(*names), once=True)

    @show_errors
    async def _begin(self, learn: list[str], check: list[str], model: list[str]) -> None:
        """Offer what is there, and choose what the address names of it."""
        await self._look()
        for choice, names in ((self._learn, learn), (self._check, check)):
            choice.set_value([name for name in names if name in choice.options])
        if model:
            found = (name for name in model if name in self._model.options)
            self._model.set_value(next(found, None))
        named = bool(learn or check or model)
        for key in ("learn", "check", "model", "rig"):
            field = getattr(self, f"_{key}")
            self._context.remember(f"explain.{key}", field, restore=not named)

    @show_errors
    async def _look(self) -> None:
        found = await asyncio.to_thread(self._sources.choices)
        for choice in (self._learn, self._check):
            if choice.options != found.recordings:
                still = [name for name in choice.value or [] if name in found.recordings]
                choice.set_options(found.recordings, value=still)
        if self._model.options != found.models:
            value = self._model.value if self._model.value in found.models else None
            self._model.set_options(found.models, value=value)

    @show_errors
    async def _uploaded(self, name: str) -> None:
        """Choose what was uploaded: first to learn from, then to check on."""
        await self._look()
        choice = self._check if self._learn.value else self._learn
        choice.set_value([*(choice.value or []), name])
        where = "to check on" if choice is self._check else "to learn from"
        notify(f"saved as {name} and chosen {where}")

    @show_errors
    def _propose(self) -> None:
        """Choose the model that suits the first recording, unless somebody has chosen one."""
        if self._model.value in (None, self._proposed) and self._learn.value:
            found = self._sources.proposed_model(self._learn.value[0])
            self._proposed = found if found in self._model.options else ""
            self._model.set_value(self._proposed or None)
        self._changed()

    def _changed(self) -> None:
        """Show the command that the form stands for, or what it lacks."""
        try:
            inputs = explain_inputs(self._sources, *self._chosen())
        except BenchtoolError as error:
            self._hint.set_text(str(error))
            self._explain.disable()
            self._command_place.set_visibility(False)
            return
        self._command_place.set_visibility(True)
        self._hint.set_text("")
        self._explain.set_enabled(not self._stages.watching)
        self._command.show(command_words(inputs, self._folder()))

    def _chosen(self) -> tuple[list[str], list[str], str, str | None]:
        learn, check = list(self._learn.value or []), list(self._check.value or [])
        return learn, check, self._model.value or "", self._rig.value

    def _folder(self) -> Path:
        return suggested_folder(self._sources, self._learn.value or [], today())

    @show_errors
    def _start(self) -> None:
        self._context.claim_control()
        inputs, out = explain_inputs(self._sources, *self._chosen()), self._folder()
        self._answer.clear()
        out.parent.mkdir(parents=True, exist_ok=True)
        words = command_words(inputs, out)
        self._stages.start(lambda: ExplainJob(out, words, explain, inputs))
        self._changed()

    @show_errors
    def _done(self, job: ExplainJob) -> None:
        self._answer.show(job)


def build(context: PageContext) -> None:
    """Make the tab; ?learn=NAME&check=NAME&model=NAME chooses recordings and a model."""
    ExplainTab(context)
