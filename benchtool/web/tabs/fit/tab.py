"""Fit tab: selection of data and model, progress and result."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from typing import Any, get_args

from nicegui import ui

from benchtool.commands.terminal.table_fit import MODEL
from benchtool.core.parameter import Parameter
from benchtool.data.run.runs_folder import RunsFolder
from benchtool.data.run.state import list_state_files
from benchtool.fit.recipe import LAWS, Basis, FitInputs, Noise, Recipe
from benchtool.report.numbers import display_unit
from benchtool.web.choices import model_choices, model_path, rig_choices
from benchtool.web.command_jobs import CommandJob
from benchtool.web.command_tab import CommandTab
from benchtool.web.context import PageContext, RunsListing
from benchtool.web.drawing import PageSection
from benchtool.web.form import InputForm
from benchtool.web.tabs.fit.data import DataCard
from benchtool.web.tabs.fit.request import (
    FitRequest,
    ParameterChoice,
    build_fit_inputs,
    data_rig,
    form_parameters,
    suggested_name,
)
from benchtool.web.tabs.runs.detail import FIGURE_WORKER
from benchtool.web.tabs.runs.view import view_fit
from benchtool.web.widgets import show_errors, show_section, show_spinner

DEFAULT_MODEL = "quad_bench"
RESULT_KEY = "fit.answer"  # form key of the displayed fit

BASES = {
    "joint": "thrust (joint fit)",
    "equal_rpm2": "T_IGE/T_OGE at equal rpm²",
    "equal_pwm": "T_IGE/T_OGE at equal pulse width",
    "equal_power": "T_IGE/T_OGE at equal electrical power",
}
NOISES = {
    "auto": "auto: scale for runs, stated for tables",
    "stated": "standard errors of the data",
    "scale": "standard errors times a common factor",
    "add": "standard errors plus a common scatter",
}
LOSSES = {
    "linear": "linear",
    "soft_l1": "soft_l1: robust against outliers",
    "huber": "huber: robust against outliers",
}

assert tuple(BASES) == get_args(Basis)
assert tuple(NOISES) == get_args(Noise)

HEADER = ("parameter", "unit", "free", "value", "bounds", "source")


class ParameterTable:
    """Table of a model's parameters; `changes` are the user's choices, free or fixed."""

    def __init__(self, context: PageContext, on_change: Callable[[], None]) -> None:
        self._context, self._on_change = context, on_change
        self._model = ""
        self._parameters: dict[str, Parameter] = {}
        self.changes: dict[str, ParameterChoice] = {}
        self._container = ui.element("div").classes("w-full wide")

    def clear(self) -> None:
        """Discard the changes before another model is shown."""
        self._parameters, self.changes = {}, {}
        self._container.clear()

    def show(self, model: str, parameters: dict[str, Parameter]) -> None:
        """Show a model's parameters and keep the user's changes, also for another rig."""
        if parameters == self._parameters:
            return
        self._model, self._parameters = model, parameters
        self._container.clear()
        with self._container, ui.element("table").classes("shown parameters"):
            with ui.element("thead"), ui.element("tr"):
                for text in HEADER:
                    with ui.element("th").props("scope=col"):
                        ui.label(text)
            with ui.element("tbody"):
                for name, parameter in parameters.items():
                    self._add_row(name, parameter)

    def _add_row(self, name: str, parameter: Parameter) -> None:
        default = ParameterChoice(parameter.free, parameter.value)
        choice = self.changes.get(name, default)
        bounds = f"{parameter.lower:g} … {parameter.upper:g}"
        bounds = bounds.replace("-", "−").replace("inf", "∞")
        with ui.element("tr"):
            with ui.element("th").props("scope=row"):
                ui.label(name)
            with ui.element("td"):
                ui.label(display_unit(parameter.unit))
            with ui.element("td"):
                free = ui.checkbox(value=choice.free).props(f'dense aria-label="{name} is free"')
            with ui.element("td"):
                value = ui.number(value=choice.value, format="%.6g").props("dense outlined")
                value.props(f'aria-label="{name} is fixed at" step=any').classes("w-32")
                value.set_enabled(not choice.free)
            with ui.element("td").classes("number soft"):
                ui.label(bounds)
            with ui.element("td").classes("soft"):
                ui.label(parameter.source)

        def read() -> None:
            number = parameter.value if value.value is None else float(value.value)
            # The field shows six digits; an unchanged field means the exact model value.
            if f"{number:.6g}" == f"{parameter.value:.6g}":
                number = parameter.value
            value.set_enabled(not free.value)
            self.changes[name] = ParameterChoice(bool(free.value), number)
            if self.changes[name] == default:
                del self.changes[name]
            self._on_change()

        free.on_value_change(read)
        value.on_value_change(read)
        for key, element in (("free", free), ("value", value)):
            self._context.persist(f"fit.{self._model}.{name}.{key}", element)


class MethodCard:
    """Methods and options of the fit."""

    def __init__(
        self,
        context: PageContext,
        models: Mapping[str, str],
        rigs: Mapping[str, str],
        on_change: Callable[[], None],
    ) -> None:
        self._form = InputForm(FitInputs, on_change)
        with ui.row().classes("items-center w-full gap-4"):
            self._squares = ui.checkbox("least squares", value=True, on_change=on_change)
            self._emcee = ui.checkbox("emcee (posterior samples)", on_change=on_change)
            context.persist("fit.least_squares", self._squares)
            context.persist("fit.emcee", self._emcee)
        with ui.element("div").classes("field-grid"):
            self._form.add("basis", options=BASES)
            self._form.add("noise", options=NOISES)
            self._form.add("rig", options=rigs)
            self._form.add("calibration", options=list_state_files("calibration"))
        options = ui.expansion("More options").classes("w-full")
        with options, ui.element("div").classes("field-grid"):
            self._form.add("compare", options={LAWS: "all ground-effect laws", **models})
            self._form.add("loss", options=LOSSES)
            self._form.add("min_z_over_r", "walkers", "max_steps", "seed", "where", "profile")
            self._form.add("budget", "temperature", "pressure", "humidity")

    def select_rig(self, rigs: Mapping[str, str], rig: str) -> None:
        self._form.choose("rig", rigs, rig)

    def options(self) -> dict[str, Any]:
        methods = {"least_squares": self._squares.value, "emcee": self._emcee.value}
        values = self._form.values()
        where = [part.strip() for part in (values["where"] or "").split(";") if part.strip()]
        selected = [method for method, is_selected in methods.items() if is_selected]
        return {**values, "method": selected, "where": where}


class FitTab(CommandTab[CommandJob]):
    """Form and result of one page."""

    label, icon, noun = "Fit", "functions", "fit"

    def __init__(self, context: PageContext, listing: RunsListing) -> None:
        super().__init__(context)
        self._suggested_name = ""
        with ui.element("div").classes("fit-form"):
            with ui.card().classes("w-full"):
                ui.label("Data").classes("card-title")
                self.data = DataCard(context, listing, self._on_data_change, self._on_rig_written)
            with ui.card().classes("w-full"):
                ui.label("Method").classes("card-title")
                models = model_choices(self.folder, self.data.entries.values())
                rigs = rig_choices(self.folder)
                self._method = MethodCard(context, models, rigs, self.change)
        with ui.card().classes("w-full"):
            with ui.row().classes("items-center w-full gap-4"):
                ui.label("Model").classes("card-title")
                self._model = ui.select(models, value=DEFAULT_MODEL, label="Model")
                self._model.props("use-input input-debounce=0").classes("grow")
                self._model.on_value_change(self._on_model_change)
            self._parameters = ParameterTable(context, self.change)
        with ui.card().classes("w-full"):
            self._name = ui.input("Name of the fit's folder", on_change=self.change)
            self._name.classes("w-full")
            self.add_controls()
        self.add_report()
        context.persist("fit.model", self._model)
        context.persist("fit.name", self._name)

    def _on_data_change(self) -> None:
        """Select the single-rotor model for tables, unless the user has selected another model."""
        if self.is_ready:
            kinds = {self.data.entries[name].kind for name in self.data.names}
            if kinds == {"table"} and self._model.value == DEFAULT_MODEL:
                self._model.set_value(MODEL)
        self.change()

    def _on_rig_written(self, path: str) -> None:
        self._method.select_rig(rig_choices(self.folder), path)

    def _on_model_change(self) -> None:
        self._parameters.clear()
        self.change()

    def read_form(self) -> tuple[str, FitInputs]:
        name = suggested_name(self.folder, self.data.names)
        if not self._name.value or self._name.value == self._suggested_name:
            self._suggested_name = name
            self._name.set_value(name)
        model = model_path(self.folder, self._model.value)
        request = FitRequest(
            data=self.data.names,
            model=self._model.value,
            choices=self._parameters.changes,
            name=(self._name.value or "").strip(),
            options=self._method.options(),
        )
        rig = data_rig(request, self.folder)
        self._parameters.show(self._model.value, form_parameters(model, rig))
        inputs = build_fit_inputs(request, self.folder, self.data.entries)
        return request.name, inputs

    def show_report(self, job: CommandJob) -> None:
        self._show_section(job.result())

    def _show_section(self, section: PageSection) -> None:
        with ui.card().classes("w-full"):
            show_section(section)

    async def show_stored(self, name: str) -> None:
        """Show a stored fit."""
        section = await self.context.compute(FIGURE_WORKER, view_fit, name)
        self.report.clear()
        with self.report:
            self._show_section(section)

    async def done(self, job: CommandJob) -> None:
        self.context.server.forms.store(self.context.tab, RESULT_KEY, job.out.name)
        await super().done(job)
        await self.data.refresh()
        self.change()


def build(context: PageContext) -> None:
    """Build the tab; ?data=NAME selects data."""
    names = ui.context.client.request.query_params.getlist("data")
    container = ui.column().classes("w-full gap-3")
    with container:
        show_spinner("reading models and runs")

    @show_errors
    async def fill() -> None:
        # Loading runs in a thread, so it never blocks the event loop and STOP.
        listing = RunsListing(RunsFolder(context.runs))
        await listing.refresh()
        await asyncio.to_thread(_preload)
        container.clear()
        with container:
            tab = FitTab(context, listing)
        context.persist("fit.data", tab.data.choice, restore=not names)
        if names:
            await tab.data.select(names)
        fit_name = context.server.forms.values(context.tab).get(RESULT_KEY)
        if fit_name and any(entry.name == fit_name for entry in listing.entries):
            await tab.show_stored(fit_name)

    ui.timer(0.0, fill, once=True)


def _preload() -> None:
    form_parameters(DEFAULT_MODEL)
    Recipe(name="any", data=("any",), model=DEFAULT_MODEL)
