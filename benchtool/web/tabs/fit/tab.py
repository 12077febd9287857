"""The Fit tab: choose runs and a model, fit with progress, look at what came out."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, get_args

from nicegui import ui

from benchtool.core.errors import BenchtoolError
from benchtool.data.run.runs_folder import RunsFolder
from benchtool.fit.recipe import Basis, FitInputs, Noise, Recipe
from benchtool.web.context import PageContext
from benchtool.web.form import InputForm
from benchtool.web.jobs import FolderJob
from benchtool.web.notifications import shows_errors
from benchtool.web.progress import JobProgress
from benchtool.web.tabs.fit.data import DataCard
from benchtool.web.tabs.fit.model_choice import (
    AdjustableParameter,
    adjustables,
    model_choices,
    model_path,
)
from benchtool.web.tabs.fit.parameters import ParameterTable
from benchtool.web.tabs.fit.request import (
    FitRequest,
    data_rig,
    recipe_for,
    suggested_name,
    words_for,
)
from benchtool.web.tabs.fit.work import FITS, start, view_fit
from benchtool.web.tabs.runs.listing import RunsListing
from benchtool.web.widgets import STYLE, CommandRow, show_section, show_waiting

USUAL_MODEL = "quad_bench"

DRAWER = "figures"
"""The process that reads runs and draws; the Runs tab has it, too."""


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


class MethodCard:
    """Ask how to fit.

    Args:
        models: to compare with, name to words.
        changed: called after every change.
    """

    def __init__(self, models: Mapping[str, str], changed: Callable[[], None]) -> None:
        self._form = InputForm(FitInputs, changed)
        with ui.row().classes("items-center w-full gap-4"):
            self._squares = ui.checkbox("least squares", value=True, on_change=changed)
            self._squares.mark("least squares")
            self._emcee = ui.checkbox("emcee (posterior samples)", on_change=changed).mark("emcee")
        with ui.element("div").classes("field-grid"):
            self._form.add("basis", options=BASES)
            self._form.add("noise", options=NOISES)
        more = ui.expansion("More options").classes("w-full")
        with more, ui.element("div").classes("field-grid"):
            self._form.add("compare", options=models)
            self._form.add("loss", options=LOSSES)
            self._form.add("min_z_over_r", "walkers", "max_steps", "seed", "where", "profile")

    def options(self) -> dict[str, Any]:
        """Return what is typed or chosen, by the names of the inputs."""
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
                self._data = DataCard(context, listing, self._changed)
            with ui.card().classes("w-full"):
                ui.label("Method").classes("card-title")
                models = model_choices(self._folder, self._data.entries.values())
                self._method = MethodCard(models, self._changed)
        with ui.card().classes("w-full"):
            with ui.row().classes("items-center w-full gap-4"):
                ui.label("Model").classes("card-title")
                self._model = ui.select(models, value=USUAL_MODEL, label="Model")
                self._model.props("use-input input-debounce=0").classes("grow").mark("model")
                self._model.on_value_change(self._other_model)
            self._parameters = ParameterTable(self._changed)
        with ui.card().classes("w-full"):
            with ui.row().classes("items-end w-full gap-4"):
                self._name = ui.input("Name of the fit's folder", on_change=self._changed)
                self._name.classes("grow").mark("fit name")
                self._fit = ui.button("Fit", icon="functions", on_click=self._start).mark("fit")
            self._command = CommandRow()
            self._hint = ui.label().classes("soft").props("role=status").mark("hint")
            self._progress = JobProgress(context, "fit", self._done)
            present = FITS.of(context.runs)
            if present is not None and present.state.running:
                self._progress.watch(present)
        self._answer = ui.column().classes("w-full scroll-place")
        self._other_model()
        self._ready = True
        self._changed()

    async def choose(self, names: list[str]) -> None:
        """Choose data as the Runs tab asks."""
        await self._data.choose(names)

    def _other_model(self) -> None:
        self._parameters.show((), {})
        self._changed()

    def _numbers(self) -> tuple[AdjustableParameter, ...]:
        """Return the chosen model's numbers on the rig of the chosen data."""
        model = model_path(self._folder, self._model.value)
        return adjustables(model, data_rig(self._data.names, self._folder))

    def _request(self) -> FitRequest:
        return FitRequest(
            data=self._data.names,
            model=self._model.value,
            choices=self._parameters.choices,
            name=(self._name.value or "").strip(),
            options=self._method.options(),
        )

    def _changed(self) -> None:
        """Show the command that the form stands for, or what it lacks."""
        if not self._ready:
            return
        suggested = suggested_name(self._folder, self._data.names)
        if not self._name.value or self._name.value == self._named:
            self._named = suggested
            self._name.set_value(suggested)
        try:
            self._parameters.put_on_rig(self._numbers())
            request = self._request()
            recipe = recipe_for(request, self._folder, self._data.entries)
            self._command.show(words_for(recipe, request, self._folder))
            self._hint.set_text("")
            self._fit.enable()
        except BenchtoolError as error:
            self._hint.set_text(str(error))
            self._fit.disable()

    @shows_errors
    def _start(self) -> None:
        self._context.claim_control()
        request = self._request()
        out = self._folder.new_path(request.name)
        recipe = recipe_for(request, self._folder, self._data.entries)
        words = words_for(recipe, request, self._folder)
        self._answer.clear()
        self._progress.watch(start(self._folder.root, recipe, out, words, request.profile))

    @shows_errors
    async def _done(self, fitting: FolderJob[str]) -> None:
        name = self._folder.name_of(fitting.out)
        section = await self._context.worker(DRAWER).run(view_fit, self._folder.root, name)
        self._answer.clear()
        with self._answer, ui.card().classes("w-full"):
            show_section(replace(section, command=fitting.words))
        self._answer.run_method("scrollIntoView", {"behavior": "smooth", "block": "start"})
        await self._data.look()
        self._changed()


def build(context: PageContext) -> None:
    """Make the tab; ?data=NAME chooses what is fitted."""
    ui.add_head_html(STYLE)
    names = ui.context.client.request.query_params.getlist("data")
    place = ui.column().classes("w-full gap-3")
    with place:
        show_waiting("reading models and runs")

    @shows_errors
    async def fill() -> None:
        # What takes long to load is loaded beside the loop, so that Stop never waits for it.
        listing = RunsListing(RunsFolder(context.runs))
        await listing.look()
        await asyncio.to_thread(_load)
        place.clear()
        with place:
            tab = FitTab(context, listing)
        if names:
            await tab.choose(names)

    ui.timer(0.0, fill, once=True)


def _load() -> None:
    adjustables(USUAL_MODEL)
    Recipe(name="any", data=("any",), model=USUAL_MODEL)
