"""The Fit tab: choose runs and a model, fit with progress, look at what came out."""

from __future__ import annotations

import asyncio
from dataclasses import replace

from nicegui import ui

from benchtool.errors import BenchtoolError
from benchtool.recipes.fit_options import recipe_of_options
from benchtool.store.runs_folder import RunsFolder
from benchtool.web.command_row import CommandRow
from benchtool.web.context import Context
from benchtool.web.fits.choice import Adjustable, adjustables, model_choices, model_path
from benchtool.web.fits.data import Data
from benchtool.web.fits.how import How
from benchtool.web.fits.jobs import view_fit
from benchtool.web.fits.order import Order, data_rig, recipe_for, suggested_name, words_for
from benchtool.web.fits.parameters import Parameters
from benchtool.web.fits.running import FITS, Fitting, start
from benchtool.web.progress import Progress
from benchtool.web.runs.listing import Listing
from benchtool.web.show import STYLE, show, waiting
from benchtool.web.tell import tells_errors

USUAL_MODEL = "quad_bench"

DRAWER = "figures"
"""The process that reads runs and draws; the Runs tab has it, too."""


class FitTab:
    """Hold the form and the answer, for one page."""

    def __init__(self, context: Context, listing: Listing) -> None:
        self._context = context
        self._folder = listing.folder
        self._ready = False
        self._named = ""
        with ui.element("div").classes("fit-form"):
            with ui.card().classes("w-full"):
                ui.label("Data").classes("card-title")
                self._data = Data(context, listing, self._changed)
            with ui.card().classes("w-full"):
                ui.label("How").classes("card-title")
                models = model_choices(self._folder, self._data.entries.values())
                self._how = How(models, self._changed)
        with ui.card().classes("w-full"):
            with ui.row().classes("items-center w-full gap-4"):
                ui.label("Model").classes("card-title")
                self._model = ui.select(models, value=USUAL_MODEL, label="Model")
                self._model.props("use-input input-debounce=0").classes("grow").mark("model")
                self._model.on_value_change(self._other_model)
            self._parameters = Parameters(self._changed)
        with ui.card().classes("w-full"):
            with ui.row().classes("items-end w-full gap-4"):
                self._name = ui.input("Name of the fit's folder", on_change=self._changed)
                self._name.classes("grow").mark("fit name")
                self._fit = ui.button("Fit", icon="functions", on_click=self._start).mark("fit")
            self._command = CommandRow()
            self._hint = ui.label().classes("soft").props("role=status").mark("hint")
            self._progress = Progress(context, "fit", self._done)
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

    def _numbers(self) -> tuple[Adjustable, ...]:
        """Return the chosen model's numbers on the rig of the chosen data."""
        model = model_path(self._folder, self._model.value)
        return adjustables(model, data_rig(self._data.names, self._folder))

    def _order(self) -> Order:
        return Order(
            data=self._data.names,
            model=self._model.value,
            wishes=self._parameters.wishes,
            name=(self._name.value or "").strip(),
            profile=self._how.profile,
            options=self._how.options(),
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
            order = self._order()
            recipe = recipe_for(order, self._folder, self._data.entries)
            self._command.show(words_for(recipe, order, self._folder))
            self._hint.set_text("")
            self._fit.enable()
        except BenchtoolError as error:
            self._hint.set_text(str(error))
            self._fit.disable()

    @tells_errors
    def _start(self) -> None:
        self._context.need_pen()
        order = self._order()
        out = self._folder.new_path(order.name)
        recipe = recipe_for(order, self._folder, self._data.entries)
        words = words_for(recipe, order, self._folder)
        self._answer.clear()
        self._progress.watch(start(self._folder.root, recipe, out, words, order.profile))

    @tells_errors
    async def _done(self, fitting: Fitting) -> None:
        name = self._folder.name_of(fitting.out)
        shown = await self._context.worker(DRAWER).run(view_fit, self._folder.root, name)
        self._answer.clear()
        with self._answer, ui.card().classes("w-full"):
            show(replace(shown, command=fitting.words))
        self._answer.run_method("scrollIntoView", {"behavior": "smooth", "block": "start"})
        await self._data.look()
        self._changed()


def build(context: Context) -> None:
    """Make the tab; ?data=NAME chooses what is fitted."""
    ui.add_head_html(STYLE)
    asked = ui.context.client.request.query_params.getlist("data")
    place = ui.column().classes("w-full gap-3")
    with place:
        waiting("reading models and runs")

    @tells_errors
    async def fill() -> None:
        # What takes long to load is loaded beside the loop, so that Stop never waits for it.
        listing = Listing(RunsFolder(context.runs))
        await listing.look()
        await asyncio.to_thread(_load)
        place.clear()
        with place:
            tab = FitTab(context, listing)
        if asked:
            await tab.choose(asked)

    ui.timer(0.0, fill, once=True)


def _load() -> None:
    adjustables(USUAL_MODEL)
    recipe_of_options({"name": "any", "data": ["any"], "model": USUAL_MODEL})
