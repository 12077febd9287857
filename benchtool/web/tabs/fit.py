"""Fit tab: selection of data and model, progress and result."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple, get_args

from nicegui import ui

from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.inputs import build_inputs
from benchtool.core.parameter import Parameter
from benchtool.core.rig import Rig
from benchtool.data.column_map import read_column_map
from benchtool.data.csv_text import read_csv_header
from benchtool.data.formats.formats import is_stand_table
from benchtool.data.run.entry import Entry
from benchtool.data.run.run import free_path
from benchtool.data.run.runs_folder import RunsFolder, column_map_path
from benchtool.data.run.state import list_state_files
from benchtool.fit.fit_data import RATIO_BASIS
from benchtool.fit.nominal import rig_for_data
from benchtool.fit.recipe import LAWS, Basis, FitInputs, Noise, Recipe
from benchtool.physics.model_file import load_model
from benchtool.report.numbers import display_unit
from benchtool.table_fit import MODEL
from benchtool.web import widgets
from benchtool.web.cards.data import DataCard
from benchtool.web.choices import check_rig_choice, model_choices, model_path, rig_choices
from benchtool.web.command_jobs import CommandJob
from benchtool.web.command_tab import CommandTab
from benchtool.web.context import PageContext, RunsListing
from benchtool.web.drawing import PageSection
from benchtool.web.entries import FIGURE_WORKER, view_fit
from benchtool.web.form import InputForm
from benchtool.web.tabs.runs import add_download, report_download
from benchtool.web.widgets import show_errors, show_spinner, titled_card

DEFAULT_MODEL = "quad_bench"


class ParameterChoice(NamedTuple):
    """Choice of a model parameter: free, or fixed at a value."""

    free: bool
    value: float


@dataclass(slots=True, kw_only=True)
class FitRequest:
    """Contents of the form."""

    data: list[str] = field(default_factory=list)  # names of runs and tables
    model: str = DEFAULT_MODEL  # key of `model_choices`
    choices: dict[str, ParameterChoice] = field(default_factory=dict)  # that differ from the model
    name: str = ""
    options: dict[str, Any] = field(default_factory=dict)


def form_parameters(model: str, rig: Rig | None = None) -> dict[str, Parameter]:
    """Return a model's parameters by full name, without noise parameters, which an option sets."""
    parameters = load_model(model, rig).model.parameters
    return {name: value for name, value in parameters.items() if not name.startswith("noise.")}


def choice_options(
    parameters: Mapping[str, Parameter], choices: Mapping[str, ParameterChoice]
) -> dict[str, object]:
    """Return the recipe options free, hold and fix for choices that differ from the model."""
    chosen = [name for name in parameters if name in choices]
    free = [name for name in chosen if choices[name].free and not parameters[name].free]
    fixed = {name: choices[name].value for name in chosen if not choices[name].free}
    fix = {name: value for name, value in fixed.items() if value != parameters[name].value}
    hold = [name for name in fixed if parameters[name].free and name not in fix]
    return {"free": free, "hold": hold, "fix": fix}


def build_fit_inputs(
    request: FitRequest, folder: RunsFolder, entries: Mapping[str, Entry]
) -> FitInputs:
    """Return the inputs of `benchtool fit` for the form; raise for missing or invalid values."""
    if not request.data:
        raise InputError(
            "no data selected; select a run or a table, measure a sweep first, or upload a CSV file"
        )
    tables = [name for name in request.data if entries[name].kind == "table"]
    files = [folder.find_file(name) for name in tables]
    stored = [path for path in map(column_map_path, files) if path.is_file()]
    if len(tables) > 1 and stored:
        raise InputError(
            f"{' and '.join(tables)} have separate column maps, but a fit uses one; fit them "
            f"separately"
        )
    model = model_path(folder, request.model)
    columns = read_column_map(stored[0]) if stored else {}
    if tables and not stored and not load_model(model).columns:
        for name, file in zip(tables, files, strict=True):
            if "thrust_N" not in read_csv_header(file) and not is_stand_table(file):
                raise InputError(
                    f"{name} has no column thrust_N; select its columns above and press Use these "
                    f"columns"
                )
    recipe = Recipe(
        name=request.name,
        data=tuple(str(folder.find_path(name)) for name in request.data),
        model=model,
        columns=str(stored[0]) if stored else None,
    )
    base = FitInputs(recipe=recipe, out=folder.root / request.name if request.name else None)
    parameters = form_parameters(model, data_rig(request, folder))
    options = dict(request.options)
    choices: dict[str, Any] = choice_options(parameters, request.choices)
    has_plate = "plate_z_m" in columns if columns else not all(map(is_stand_table, files))
    if "R_m" in parameters and tables and not has_plate:
        # As in the command: without a plate, the effective radius is not identifiable.
        choices["hold"] = sorted({*choices["hold"], "R_m"} - choices["fix"].keys())
    if "thrust_ratio" in columns and not options.get("basis"):
        options["basis"] = RATIO_BASIS
    if {"thrust_sd_N", "thrust_ratio_sd"} & columns.keys() and not options.get("noise"):
        options["noise"] = "scale"
    calibrations = list_state_files("calibration")  # the page opens no other calibration files
    calibration = options.get("calibration")
    if calibration is not None and calibration not in calibrations:
        raise UnknownChoice("calibration", str(calibration), calibrations)
    return build_inputs(FitInputs, {**choices, **options}, source="label", base=base)


def data_rig(request: FitRequest, folder: RunsFolder) -> Rig | None:
    """Return the rig of the data; None for the rig of the model file."""
    rig = check_rig_choice(request.options.get("rig"), folder)
    paths = [str(folder.find_path(name)) for name in request.data]
    try:
        return rig_for_data(paths, request.model, rig)
    except InputError as error:
        if rig is not None or "--rig" not in str(error):
            raise
        raise InputError(
            f"{request.data[0]} does not say which rig it was measured on; select Rig of a table, "
            f"or make a rig of it. Motor constants need no rig: open the log under Runs"
        ) from None


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
        self._on_change()

    def show(self, model: str, parameters: dict[str, Parameter]) -> None:
        """Show a model's parameters and keep the user's changes, also for another rig."""
        if parameters == self._parameters:
            return
        self._model, self._parameters = model, parameters
        self._container.clear()
        with self._container, ui.element("table").classes("shown parameters w-full"):
            with ui.element("thead"), ui.element("tr"):
                for text in ("parameter", "unit", "free", "value", "bounds", "source"):
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

        def cell(label: str) -> ui.element:
            return ui.element("td").props(f"data-label={label}")

        with ui.element("tr"):
            with ui.element("th").props("scope=row"):
                ui.label(name)
            with cell("unit"):
                ui.label(display_unit(parameter.unit))
            with cell("free"):
                free = ui.checkbox(value=choice.free).props(f'dense aria-label="{name} is free"')
            with cell("value"):
                value = ui.number(value=choice.value, format="%.6g").props("dense outlined")
                value.props(f'aria-label="{name} is fixed at" step=any').classes("w-44")
                value.set_enabled(not choice.free)
            with cell("bounds").classes("number soft"):
                ui.label(bounds)
            with cell("source").classes("soft"):
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


class FitTab(CommandTab):
    """Form and result of one page."""

    label, icon, noun = "Fit", "functions", "fit"

    def __init__(self, context: PageContext, listing: RunsListing) -> None:
        super().__init__(context)
        self._suggested_name = ui.input().classes("hidden")  # stored, so that a typed name is known
        with self.inputs:
            with ui.element("div").classes("fit-form"):
                with titled_card("Data"):
                    self.data = DataCard(context, listing, self._on_data_change, self._choose_rig)
                with titled_card("Method"):
                    models = model_choices(self.folder, self.data.entries.values())
                    self._build_method(models)
            with titled_card("Model"):
                self._model = ui.select(models, value=DEFAULT_MODEL)
                self._model.props('use-input input-debounce=0 dense aria-label="Model"')
                self._parameters = ParameterTable(context, self.change)
                self._model.classes("w-full").on_value_change(self._parameters.clear)
            with ui.card().classes("w-full"):
                self._name = ui.input("Name of the fit's folder", on_change=self.change)
                self._name.props("dense").classes("w-full")
                self.add_controls()
        self.show_latest()
        context.persist("fit.model", self._model)
        context.persist("fit.suggested_name", self._suggested_name)
        context.persist("fit.name", self._name)

    def _build_method(self, models: Mapping[str, str]) -> None:
        with ui.row().classes("items-center w-full"):
            self._squares = ui.checkbox("least squares", value=True, on_change=self.change)
            self._emcee = ui.checkbox("emcee (posterior samples)", on_change=self.change)
            self.context.persist("fit.least_squares", self._squares)
            self.context.persist("fit.emcee", self._emcee)
        self._form = form = InputForm(FitInputs, self.change)
        with ui.element("div").classes("field-grid large"):
            form.add("basis", options=BASES)
            form.add("noise", options=NOISES)
            form.add("rig", options=rig_choices(self.folder))
            form.add("calibration", options=list_state_files("calibration"))
        options = ui.expansion("More options").classes("w-full")
        with options, ui.element("div").classes("field-grid"):
            form.add("compare", options={LAWS: "all ground-effect laws", **models})
            form.add("loss", options=LOSSES)
            form.add("min_z_over_r", "walkers", "max_steps", "seed", "profile")
            form.add("budget", "temperature", "pressure", "humidity")
        with options:
            form.add("where")

    def _read_options(self) -> dict[str, Any]:
        methods = {"least_squares": self._squares.value, "emcee": self._emcee.value}
        values = self._form.values()
        where = [part.strip() for part in (values["where"] or "").split(";") if part.strip()]
        selected = [method for method, is_selected in methods.items() if is_selected]
        return {**values, "method": selected, "where": where}

    def _on_data_change(self) -> None:
        """Select the single-rotor model for tables, unless the user has selected another model."""
        if self.is_ready:
            self._failed.set_visibility(False)
            kinds = {self.data.entries[name].kind for name in self.data.names}
            if kinds == {"table"} and self._model.value == DEFAULT_MODEL:
                self._model.set_value(MODEL)
        self.change()

    def _choose_rig(self, path: str) -> None:
        self._form.choose("rig", rig_choices(self.folder), path)

    def read_form(self) -> tuple[str, FitInputs]:
        first = self.data.names[0].rsplit("/", 1)[-1] if self.data.names else "data"
        stem = re.sub(r"[^A-Za-z0-9._-]+", "-", first.removesuffix(".csv"))
        name = free_path(self.folder.root / f"fit-{stem}").name
        if self._name.value in (None, "", self._suggested_name.value):
            self._suggested_name.set_value(name)
            self._name.set_value(name)
        model = model_path(self.folder, self._model.value)
        request = FitRequest(
            data=self.data.names,
            model=self._model.value,
            choices=self._parameters.changes,
            name=(self._name.value or "").strip(),
            options=self._read_options(),
        )
        rig = data_rig(request, self.folder)
        self._parameters.show(self._model.value, form_parameters(model, rig))
        inputs = build_fit_inputs(request, self.folder, self.data.entries)
        return request.name, inputs

    def show_report(self, job: CommandJob) -> None:
        self.show_fit(job.result())

    def show_fit(self, section: PageSection) -> None:
        with ui.card().classes("w-full"):
            widgets.show_title(section)
            add_download(self.context, report_download(section.title, (section.title,)))
            widgets.show_section(section)

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
        await asyncio.to_thread(form_parameters, DEFAULT_MODEL)
        await asyncio.to_thread(Recipe, name="any", data=("any",), model=DEFAULT_MODEL)
        container.clear()
        with container:
            tab = FitTab(context, listing)
        context.persist("fit.data", tab.data.choice, restore=not names)
        fit_name = context.server.forms.values(context.tab).get(RESULT_KEY)
        if names:
            await tab.data.select(names)
        if fit_name and any(entry.name == fit_name for entry in listing.entries):
            section = await context.compute(FIGURE_WORKER, view_fit, fit_name)
            tab.replace_report(partial(tab.show_fit, section))
        if names:
            tab.inputs.set_value(True)

    ui.timer(0.0, fill, once=True)
