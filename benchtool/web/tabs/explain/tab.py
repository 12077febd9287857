"""Explain tab: selection of recordings and model, progress, result and its acceptance."""

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
    command_arguments,
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

DESCRIPTION = (
    "Shows where recordings disagree with a model, and which physical effect the model lacks. The "
    "model is fitted to training recordings and validated on others of the same bench."
)

OPEN_SECTIONS = ("What now", "Where", "Which", "The gap")  # expanded by default


class ResultView:
    """Result of an explanation with a button to accept it."""

    def __init__(
        self,
        context: PageContext,
        sources: RecordingSources,
        on_written: Callable[[], Awaitable[None]],
    ) -> None:
        self._context, self._sources, self._on_written = context, sources, on_written
        self._container = ui.column().classes("w-full gap-3 scroll-place")

    def clear(self) -> None:
        self._container.clear()

    def show(self, job: ExplainJob) -> None:
        result = job.state.result
        if result is None:
            return
        self.clear()
        with self._container:
            with ui.card().classes("w-full gap-2"):
                self._show_header(job, result)
            for section in result.sections:
                if section.title in OPEN_SECTIONS:
                    with ui.card().classes("w-full"):
                        show_section(section)
            with ui.card().classes("w-full"):
                for section in result.sections:
                    if section.title not in OPEN_SECTIONS:
                        with ui.expansion(section.title).classes("w-full").props("dense"):
                            show_section(section, has_header=False)
        self._container.run_method("scrollIntoView", {"behavior": "smooth", "block": "start"})

    def _show_header(self, job: ExplainJob, result: ExplanationResult) -> None:
        with ui.row().classes("items-center gap-3"):
            ui.label("Result").classes("card-title")
            show_stamp(result.simulated)
            ui.label(f"after {result.seconds:.1f} s").classes("soft")
        ui.label(result.sentence).classes("text-h6").props("role=status")
        ui.html(result.highlights, sanitize=False).classes("shown-body")
        CommandRow(job.command)
        with ui.row().classes("items-center gap-4 w-full"):
            effects = result.new_effects
            label = f"Accept {' and '.join(effects)} into a new model"
            button = ui.button(label if effects else "Save this result", icon="check")
            status = ui.html(self._status(job, result), sanitize=False).props("role=status")

        @show_errors
        async def accept() -> None:
            self._context.claim_control()
            button.disable()
            try:
                # If the name has been taken meanwhile, a number is appended.
                await run.io_bound(job.accept, free_path(job.out))
            finally:
                button.set_enabled(job.accepted_model is None)
            status.set_content(self._status(job, result))
            await self._on_written()

        button.on_click(accept)
        button.set_enabled(job.accepted_model is None)

    def _status(self, job: ExplainJob, result: ExplanationResult) -> str:
        """Return the files to be written, or a link to the written folder, as HTML."""
        if job.accepted_model is None:
            files = "model.toml, report and figures" if result.new_effects else "report and figures"
            return f'<span class="soft">writes {files} to {escape(str(job.out))}</span>'
        address = "?" + urlencode({"tab": "runs", "run": self._sources.runs.relative_name(job.out)})
        link = f'<a href="{escape(address)}">{escape(job.out.name)}</a>'
        if not job.accepted_model:
            return f"saved as {link}"
        model = escape(job.accepted_model)
        return f"model <b>{model}</b> was written to {link}; it can be selected above"


class ExplainTab:
    """Form and result of one page."""

    def __init__(self, context: PageContext) -> None:
        self._context = context
        self._suggested_model = ""
        self._sources = RecordingSources.from_folder(context.runs)
        ui.add_head_html(STYLE + _STYLE)
        with ui.card().classes("w-full gap-2"):
            ui.label("Recordings and model").classes("card-title")
            ui.label(DESCRIPTION).classes("soft")
            with ui.element("div").classes("fit-form w-full"):
                with ui.column().classes("w-full gap-2"):
                    self._learn = multiple_choice("Training recordings", self._suggest_model)
                    self._check = multiple_choice("Validation recordings", self._changed)
                with ui.column().classes("w-full gap-2"):
                    self._model = ui.select({}, label="Model", on_change=self._changed)
                    self._model.props("use-input input-debounce=0").classes("w-full")
                    rigs = rig_choices(self._sources.runs)
                    self._rig = ui.select(rigs, label="Rig of a table", on_change=self._changed)
                    self._rig.props("clearable").classes("w-full")
                    TableUpload(context, self._uploaded)
            for select in (self._learn, self._check, self._model):
                select.on("popup-show", self._refresh)
            with ui.row().classes("items-center w-full gap-4"):
                self._explain = ui.button("Explain", icon="troubleshoot", on_click=self._start)
                self._hint = ui.label().classes("soft").props("role=status")
            with ui.element("div").classes("w-full") as self._command_container:
                self._command = CommandRow()
            self._progress: JobProgress[ExplainJob] = JobProgress(
                context, "explanations", "explanation", self._done, self._changed, has_stages=True
            )
        self._result = ResultView(context, self._sources, self._refresh)
        self._changed()
        if self._progress.latest is not None:
            self._result.show(self._progress.latest)
        query = ui.context.client.request.query_params
        names = [query.getlist(key) for key in ("learn", "check", "model")]
        ui.timer(0.0, lambda: self._select(*names), once=True)

    @show_errors
    async def _select(self, learn: list[str], check: list[str], model: list[str]) -> None:
        """Read the available choices and select those of the page's address."""
        await self._refresh()
        for select, names in ((self._learn, learn), (self._check, check)):
            select.set_value([name for name in names if name in select.options])
        if model:
            available = (name for name in model if name in self._model.options)
            self._model.set_value(next(available, None))
        has_query = bool(learn or check or model)
        for key in ("learn", "check", "model", "rig"):
            field = getattr(self, f"_{key}")
            self._context.persist(f"explain.{key}", field, restore=not has_query)

    @show_errors
    async def _refresh(self) -> None:
        choices = await asyncio.to_thread(self._sources.read_choices)
        for select in (self._learn, self._check):
            if select.options != choices.recordings:
                selected = [name for name in select.value or [] if name in choices.recordings]
                select.set_options(choices.recordings, value=selected)
        if self._model.options != choices.models:
            value = self._model.value if self._model.value in choices.models else None
            self._model.set_options(choices.models, value=value)

    @show_errors
    async def _uploaded(self, name: str) -> None:
        """Select an uploaded recording, for validation if a training recording is selected."""
        await self._refresh()
        select = self._check if self._learn.value else self._learn
        select.set_value([*(select.value or []), name])
        purpose = "validation" if select is self._check else "training"
        notify(f"saved as {name}, selected for {purpose}")

    @show_errors
    def _suggest_model(self) -> None:
        """Select the model for the first recording, unless the user has selected one."""
        if self._model.value in (None, self._suggested_model) and self._learn.value:
            model = self._sources.suggest_model(self._learn.value[0])
            self._suggested_model = model if model in self._model.options else ""
            self._model.set_value(self._suggested_model or None)
        self._changed()

    def _changed(self) -> None:
        """Show the form's command or its first error."""
        try:
            inputs = explain_inputs(self._sources, *self._selection())
        except BenchtoolError as error:
            self._hint.set_text(str(error))
            self._explain.disable()
            self._command_container.set_visibility(False)
            return
        self._command_container.set_visibility(True)
        self._hint.set_text("")
        self._explain.set_enabled(not self._progress.is_watching)
        self._command.show(command_arguments(inputs, self._folder()))

    def _selection(self) -> tuple[list[str], list[str], str, str | None]:
        learn, check = list(self._learn.value or []), list(self._check.value or [])
        return learn, check, self._model.value or "", self._rig.value

    def _folder(self) -> Path:
        return suggested_folder(self._sources, self._learn.value or [], today())

    @show_errors
    def _start(self) -> None:
        self._context.claim_control()
        inputs, out = explain_inputs(self._sources, *self._selection()), self._folder()
        self._result.clear()
        out.parent.mkdir(parents=True, exist_ok=True)
        arguments = command_arguments(inputs, out)
        self._progress.start(lambda: ExplainJob(out, arguments, explain, inputs))
        self._changed()

    @show_errors
    def _done(self, job: ExplainJob) -> None:
        self._result.show(job)


def build(context: PageContext) -> None:
    """Build the tab; ?learn=NAME&check=NAME&model=NAME selects recordings and a model."""
    ExplainTab(context)
