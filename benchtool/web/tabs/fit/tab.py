"""The Fit tab: choose runs and a model, fit with progress, look at what came out."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, get_args

from nicegui import ui

from benchtool.commands.terminal.table_fit import MODEL
from benchtool.core.errors import BenchtoolError
from benchtool.core.parameter import Parameter
from benchtool.data.run.runs_folder import RunsFolder
from benchtool.data.run.state import recall_state
from benchtool.fit.recipe import LAWS, Basis, FitInputs, Noise, Recipe
from benchtool.report.numbers import display_unit
from benchtool.web.context import PageContext, RunsListing
from benchtool.web.form import InputForm
from benchtool.web.jobs import Job
from benchtool.web.progress import JobProgress
from benchtool.web.tabs.fit import model_choice
from benchtool.web.tabs.fit.data import DataCard
from benchtool.web.tabs.fit.work import fit_to_folder, view_fit
from benchtool.web.widgets import STYLE, CommandRow, show_errors, show_section, show_waiting

USUAL_MODEL = "quad_bench"

DRAWER = "figures"  # The process that reads runs and draws; the Runs tab has it, too
FITS = "fits"  # Kind of the jobs
ANSWER = "fit.answer"  # Under this name the page remembers which fit it shows

BASES = {
    "joint": "thrust itself (joint fit)",
    "equal_rpm2": "T_IGE/T_OGE at equal rpm²",
    "equal_pwm": "T_IGE/T_OGE at equal pulse width",
    "equal_power": "T_IGE/T_OGE at equal electrical power",
}
NOISES = {
    "auto": "auto: scaled in a run, stated in a table",
    "stated": "the errors as they are stated",
    "scale": "one factor on the errors",
    "add": "scatter added to the errors",
}
LOSSES = {
    "linear": "linear",
    "soft_l1": "soft_l1: distant points count less",
    "huber": "huber: distant points count less",
}

assert tuple(BASES) == get_args(Basis)
assert tuple(NOISES) == get_args(Noise)

HEADS = ("parameter", "unit", "free", "value", "bounds", "where the value comes from")


class ParameterTable:
    """Show a model's numbers, each free or fixed, and what is chosen of each."""

    def __init__(self, context: PageContext, changed: Callable[[], None]) -> None:
        self._context, self._changed = context, changed
        self._model = ""
        self._numbers: dict[str, Parameter] = {}
        self.choices: dict[str, model_choice.ParameterChoice] = {}
        self._place = ui.element("div").classes("w-full wide")

    def clear(self) -> None:
        """Forget what was chosen: another model follows."""
        self._numbers, self.choices = {}, {}
        self._place.clear()

    def show(self, model: str, numbers: dict[str, Parameter]) -> None:
        """Show a model's numbers; what somebody changed stays, also on another rig."""
        if numbers == self._numbers:
            return
        before = self._numbers
        self._model, self._numbers = model, numbers
        changed = {k: to for k, to in self.choices.items() if to != _of_model(before[k])}
        self.choices = {k: changed.get(k, _of_model(own)) for k, own in numbers.items()}
        self._place.clear()
        with self._place, ui.element("table").classes("shown parameters"):
            with ui.element("thead"), ui.element("tr"):
                for head in HEADS:
                    with ui.element("th").props("scope=col"):
                        ui.label(head)
            with ui.element("tbody"):
                for name, number in numbers.items():
                    self._row(name, number)

    def _row(self, name: str, number: Parameter) -> None:
        choice = self.choices[name]
        bounds = f"{number.lower:g} … {number.upper:g}".replace("-", "−").replace("inf", "∞")
        with ui.element("tr"):
            with ui.element("th").props("scope=row"):
                ui.label(name)
            with ui.element("td"):
                ui.label(display_unit(number.unit))
            with ui.element("td"):
                free = ui.checkbox(value=choice.free).props(f'dense aria-label="{name} is free"')
            with ui.element("td"):
                value = ui.number(value=choice.value, format="%.6g").props("dense outlined")
                value.props(f'aria-label="{name} is held at" step=any').classes("w-32")
                value.set_enabled(not choice.free)
            with ui.element("td").classes("number soft"):
                ui.label(bounds)
            with ui.element("td").classes("soft"):
                ui.label(number.source)

        def read() -> None:
            held = number.value if value.value is None else float(value.value)
            # The number shows six digits: left as it is, it is the model's own.
            if f"{held:.6g}" == f"{number.value:.6g}":
                held = number.value
            value.set_enabled(not free.value)
            self.choices[name] = model_choice.ParameterChoice(bool(free.value), held)
            self._changed()

        free.on_value_change(read)
        value.on_value_change(read)
        for what, element in (("free", free), ("value", value)):
            self._context.remember(f"fit.{self._model}.{name}.{what}", element)


def _of_model(number: Parameter) -> model_choice.ParameterChoice:
    return model_choice.ParameterChoice(number.free, number.value)


class MethodCard:
    """Choose how to fit."""

    def __init__(
        self,
        context: PageContext,
        models: Mapping[str, str],
        rigs: Mapping[str, str],
        changed: Callable[[], None],
    ) -> None:
        self._form = InputForm(FitInputs, changed)
        with ui.row().classes("items-center w-full gap-4"):
            self._squares = ui.checkbox("least squares", value=True, on_change=changed)
            self._emcee = ui.checkbox("emcee (posterior samples)", on_change=changed)
            context.remember("fit.least_squares", self._squares)
            context.remember("fit.emcee", self._emcee)
        with ui.element("div").classes("field-grid"):
            self._form.add("basis", options=BASES)
            self._form.add("noise", options=NOISES)
            self._form.add("rig", options=rigs)
            self._form.add("calibration", options=recall_state("calibration"))
        more = ui.expansion("More options").classes("w-full")
        with more, ui.element("div").classes("field-grid"):
            self._form.add("compare", options={LAWS: "all laws of distance", **models})
            self._form.add("loss", options=LOSSES)
            self._form.add("min_z_over_r", "walkers", "max_steps", "seed", "where", "profile")
            self._form.add("budget", "temperature", "pressure", "humidity")

    def choose_rig(self, rigs: Mapping[str, str], chosen: str) -> None:
        self._form.choose("rig", rigs, chosen)

    def options(self) -> dict[str, Any]:
        methods = {"least_squares": self._squares.value, "emcee": self._emcee.value}
        given = self._form.given()
        where = [part.strip() for part in (given["where"] or "").split(";") if part.strip()]
        chosen = [method for method, wanted in methods.items() if wanted]
        return {**given, "method": chosen, "where": where}


class FitTab:
    """Hold the form and the answer, for one page."""

    def __init__(self, context: PageContext, listing: RunsListing) -> None:
        self._context = context
        self._folder = listing.folder
        self._ready = False
        self._named = ""
        with ui.element("div").classes("fit-form"):
            with ui.card().classes("w-full"):
                ui.label("Data").classes("card-title")
                self.data = DataCard(context, listing, self._data_changed, self._rig_made)
            with ui.card().classes("w-full"):
                ui.label("Method").classes("card-title")
                models = model_choice.model_choices(self._folder, self.data.entries.values())
                self._method = MethodCard(
                    context, models, model_choice.rig_choices(self._folder), self._changed
                )
        with ui.card().classes("w-full"):
            with ui.row().classes("items-center w-full gap-4"):
                ui.label("Model").classes("card-title")
                self._model = ui.select(models, value=USUAL_MODEL, label="Model")
                self._model.props("use-input input-debounce=0").classes("grow")
                self._model.on_value_change(self._other_model)
            self._parameters = ParameterTable(context, self._changed)
        with ui.card().classes("w-full"):
            with ui.row().classes("items-end w-full gap-4"):
                self._name = ui.input("Name of the fit's folder", on_change=self._changed)
                self._name.classes("grow")
                self._fit = ui.button("Fit", icon="functions", on_click=self._start)
            self._command = CommandRow()
            self._hint = ui.label().classes("soft").props("role=status")
            self._progress = JobProgress(context, FITS, "fit", self._done)
        self._answer = ui.column().classes("w-full scroll-place")
        self._ready = True
        self._changed()
        context.remember("fit.model", self._model)
        context.remember("fit.name", self._name)

    def _data_changed(self) -> None:
        """Choose the model of one rotor for a table alone, until somebody chooses another."""
        kinds = {self.data.entries[name].kind for name in self.data.names}
        if self._ready and kinds == {"table"} and self._model.value == USUAL_MODEL:
            self._model.set_value(MODEL)
        self._changed()

    def _rig_made(self, path: str) -> None:
        self._method.choose_rig(model_choice.rig_choices(self._folder), path)

    def _other_model(self) -> None:
        self._parameters.clear()
        self._changed()

    def _request(self) -> model_choice.FitRequest:
        return model_choice.FitRequest(
            data=self.data.names,
            model=self._model.value,
            choices=dict(self._parameters.choices),
            name=(self._name.value or "").strip(),
            options=self._method.options(),
        )

    def _changed(self) -> None:
        if not self._ready:
            return
        suggested = model_choice.suggested_name(self._folder, self.data.names)
        if not self._name.value or self._name.value == self._named:
            self._named = suggested
            self._name.set_value(suggested)
        try:
            model = model_choice.model_path(self._folder, self._model.value)
            request = self._request()
            self._parameters.show(
                self._model.value,
                model_choice.form_numbers(model, model_choice.data_rig(request, self._folder)),
            )
            request = self._request()
            recipe = model_choice.recipe_for(request, self._folder, self.data.entries)
            self._command.show(model_choice.command_arguments(recipe, request, self._folder))
            self._hint.set_text("")
            self._fit.enable()
        except BenchtoolError as error:
            self._hint.set_text(str(error))
            self._fit.disable()

    @show_errors
    def _start(self) -> None:
        self._context.claim_control()
        request = self._request()
        out = self._folder.new_path(request.name)
        recipe = model_choice.recipe_for(request, self._folder, self.data.entries)
        words = model_choice.command_arguments(recipe, request, self._folder)
        self._answer.clear()
        profile = bool(request.options["profile"])
        budget = request.options["budget"] or "propagation"
        self._progress.start(lambda: Job(out, words, fit_to_folder, recipe, profile, budget))

    async def show_answer(self, name: str, words: tuple[str, ...] = ()) -> None:
        """Show a fit that was written."""
        section = await self._context.worker(DRAWER).run(view_fit, self._folder.root, name)
        self._answer.clear()
        with self._answer, ui.card().classes("w-full"):
            show_section(replace(section, command=words or section.command))

    @show_errors
    async def _done(self, job: Job[str]) -> None:
        name = self._folder.name_of(job.out)
        self._context.server.forms.note(self._context.tab, ANSWER, name)
        await self.show_answer(name, job.words)
        self._answer.run_method("scrollIntoView", {"behavior": "smooth", "block": "start"})
        await self.data.look()
        self._changed()


def build(context: PageContext) -> None:
    """Make the tab; ?data=NAME chooses what is fitted."""
    ui.add_head_html(STYLE)
    names = ui.context.client.request.query_params.getlist("data")
    place = ui.column().classes("w-full gap-3")
    with place:
        show_waiting("reading models and runs")

    @show_errors
    async def fill() -> None:
        # What takes long to load is loaded beside the loop, so that Stop never waits for it.
        listing = RunsListing(RunsFolder(context.runs))
        await listing.look()
        await asyncio.to_thread(_load)
        place.clear()
        with place:
            tab = FitTab(context, listing)
        context.remember("fit.data", tab.data.choice, restore=not names)
        if names:
            await tab.data.choose(names)
        answer = context.server.forms.values(context.tab).get(ANSWER)
        if answer and any(entry.name == answer for entry in listing.entries):
            await tab.show_answer(answer)

    ui.timer(0.0, fill, once=True)


def _load() -> None:
    model_choice.form_numbers(USUAL_MODEL)
    Recipe(name="any", data=("any",), model=USUAL_MODEL)
