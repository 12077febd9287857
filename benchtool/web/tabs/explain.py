"""Explain tab: selection of recordings and model, result and its acceptance."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Sequence
from functools import partial
from html import escape
from pathlib import Path
from urllib.parse import urlencode

from nicegui import run, ui

from benchtool.core.errors import InputError
from benchtool.data.run.run import free_path
from benchtool.explain.inputs import ExplainInputs
from benchtool.fit.nominal import rig_for_data
from benchtool.web import widgets
from benchtool.web.choices import RecordingSources, check_rig_choice, rig_choices
from benchtool.web.command_jobs import CommandJob, Explanation
from benchtool.web.command_tab import CommandTab
from benchtool.web.context import PageContext

DESCRIPTION = (
    "Shows where recordings disagree with a model, and which physical effect the model lacks. The "
    "model is fitted to training recordings and validated on others of the same bench."
)


def explain_inputs(
    sources: RecordingSources,
    learn: Sequence[str],
    check: Sequence[str],
    model: str,
    rig: str | None = None,
    out: Path | None = None,
) -> ExplainInputs:
    """Return the inputs of `benchtool explain` for the selected choices."""
    if not learn:
        raise InputError(
            "no training recording is selected; select one, save one under Simulate, or record "
            "one under Bench"
        )
    if not check:
        raise InputError(
            "no validation recording is selected; select another recording of the same bench"
        )
    if common := set(learn) & set(check):
        raise InputError(
            f"{', '.join(sorted(common))} is selected for both training and validation; select "
            f"different recordings"
        )
    if not model:
        raise InputError("no model is selected; select the model that describes the recordings")
    inputs = ExplainInputs(
        recordings=tuple(str(sources.find_path(name)) for name in learn),
        check=tuple(str(sources.find_path(name)) for name in check),
        model=sources.find_model(model),
        rig=check_rig_choice(rig, sources.runs),
        out=out,
    )
    rig_for_data((*inputs.recordings, *inputs.check), inputs.model, inputs.rig)
    return inputs


def suggested_folder(sources: RecordingSources, learn: Sequence[str], date: str) -> Path:
    """Return a free folder for the result of some recordings."""
    first = Path(learn[0].rsplit("/", 1)[-1]).stem if learn else "recording"
    stem = re.sub(r"[^A-Za-z0-9_-]+", "-", first).strip("-_")[:40] or "recording"
    return sources.runs.free_path(date, f"explain-{stem}")


class ExplainTab(CommandTab):
    """Form and result of one page; ?learn=NAME&check=NAME&model=NAME selects the inputs."""

    label, icon, noun = "Explain", "troubleshoot", "explanation"

    def __init__(self, context: PageContext) -> None:
        super().__init__(context)
        self._suggested_model = ""
        self._sources = RecordingSources.from_folder(context.runs)
        with self.inputs, widgets.titled_card("Recordings and model"):
            ui.label(DESCRIPTION).classes("soft")
            with ui.element("div").classes("fit-form w-full"):
                with ui.column().classes("w-full gap-3"):
                    self._learn = widgets.multiple_choice(
                        "Training recordings", self._suggest_model
                    )
                    self._check = widgets.multiple_choice("Validation recordings", self.change)
                with ui.column().classes("w-full gap-3"):
                    self._model = ui.select({}, label="Model", on_change=self.change)
                    self._model.props("use-input input-debounce=0").classes("w-full")
                    rigs = rig_choices(self.folder)
                    self._rig = ui.select(rigs, label="Rig of a table", on_change=self.change)
                    self._rig.props("clearable").classes("w-full")
                    widgets.add_table_upload(context, self._uploaded)
            for select in (self._learn, self._check, self._model):
                select.on("popup-show", self._read_choices)
            self.add_controls()
        self.show_latest()
        query = ui.context.client.request.query_params
        names = [query.getlist(key) for key in ("learn", "check", "model")]
        ui.timer(0.0, lambda: self._select(*names), once=True)

    @widgets.show_errors
    async def _select(self, learn: list[str], check: list[str], model: list[str]) -> None:
        """Read the available choices and select those of the page's address."""
        await self._read_choices()
        for select, names in ((self._learn, learn), (self._check, check)):
            select.set_value([name for name in names if name in select.options])
        if model:
            available = (name for name in model if name in self._model.options)
            self._model.set_value(next(available, None))
        if has_query := bool(learn or check or model):
            self.inputs.set_value(True)
        for key in ("learn", "check", "model", "rig"):
            field = getattr(self, f"_{key}")
            self.context.persist(f"explain.{key}", field, restore=not has_query)

    @widgets.show_errors
    async def _read_choices(self) -> None:
        recordings, models = await asyncio.to_thread(self._sources.read_choices)
        for select in (self._learn, self._check):
            widgets.replace_options(select, recordings)
        widgets.replace_options(self._model, models)

    @widgets.show_errors
    async def _uploaded(self, name: str) -> None:
        """Select an uploaded recording, for validation if a training recording is selected."""
        await self._read_choices()
        select = self._check if self._learn.value else self._learn
        select.set_value([*(select.value or []), name])
        purpose = "validation" if select is self._check else "training"
        widgets.notify(f"saved as {name}, selected for {purpose}")

    @widgets.show_errors
    def _suggest_model(self) -> None:
        """Select the model for the first recording, unless the user has selected one."""
        if self._model.value in (None, self._suggested_model) and self._learn.value:
            model = self._sources.suggest_model(self._learn.value[0])
            self._suggested_model = model if model in self._model.options else ""
            self._model.set_value(self._suggested_model or None)
        self.change()

    def read_form(self) -> tuple[str, ExplainInputs]:
        learn, check = list(self._learn.value or []), list(self._check.value or [])
        out = suggested_folder(self._sources, learn, widgets.today())
        model, rig = self._model.value or "", self._rig.value
        return out.name, explain_inputs(self._sources, learn, check, model, rig, out)

    def show_report(self, job: CommandJob) -> None:
        result: Explanation = job.result()
        with ui.card().classes("w-full"):
            widgets.show_title(result.head, f"after {result.seconds:.1f} s")
            widgets.show_html(result.head)
            self._add_acceptance(job, result)
            widgets.show_section(result.section)

    def _add_acceptance(self, job: CommandJob, result: Explanation) -> None:
        with ui.row().classes("items-center w-full"):
            effects = result.new_effects
            label = f"Accept {' and '.join(effects)} into a new model"
            button = ui.button(label if effects else "Save this result", icon="check")
            button.set_enabled(job.accepted_model is None)
            ui.html(self._status(job, result), sanitize=False).props("role=status")

        @widgets.show_errors
        async def accept() -> None:
            self.context.claim_control()
            button.disable()
            try:
                # If the name has been taken meanwhile, a number is appended.
                await run.io_bound(job.accept, free_path(job.out))
                await self._read_choices()
            finally:
                self.replace_report(partial(self.show_report, job))

        button.on_click(accept)

    def _status(self, job: CommandJob, result: Explanation) -> str:
        """Return the files to be written, or a link to the written folder, as HTML."""
        if job.accepted_model is None:
            files = "model.toml, report and figures" if result.new_effects else "report and figures"
            return f'<span class="soft">writes {files} to {escape(str(job.out))}</span>'
        address = "?" + urlencode({"tab": "runs", "run": self.folder.relative_name(job.out)})
        link = f'<a href="{escape(address)}">{escape(job.out.name)}</a>'
        if not job.accepted_model:
            return f"saved as {link}"
        model = escape(job.accepted_model)
        return f"model <b>{model}</b> was written to {link}; it can be selected under Inputs"


build = ExplainTab
