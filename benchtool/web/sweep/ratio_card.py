"""The plot of a sweep, kept up with the run folder on the disk."""

from __future__ import annotations

import asyncio
from pathlib import Path

from nicegui import ui

from benchtool.core.rig import Rig
from benchtool.errors import BenchtoolError
from benchtool.store.ratios import RATIO_BASES
from benchtool.web.bench_link import BenchLink
from benchtool.web.context import Context
from benchtool.web.sweep.plot import RatioPlot
from benchtool.web.sweep.work import Curve, Points, measured_points, model_curves

WORKER = "plots"

AT = {
    "equal_rpm2": "equal rpm²",
    "equal_pwm": "equal pulse",
    "equal_power": "equal power",
}
"""Words for what is held equal."""

assert tuple(AT) == RATIO_BASES

STANDARD = {1: "single_bench", 4: "quad_bench"}
"""Model that is shown first, by the number of discs."""

SPAN = (0.5, 5.0)
"""Distances z/R of the curves; where the image formulae hold, and where little is left."""


class RatioCard:
    """Show the ratios of the present run over a model of choice."""

    def __init__(self, context: Context) -> None:
        from benchtool.library import model_names

        self._context = context
        self._shown: tuple[object, ...] = ()
        self._rig_name = ""
        self._curves: tuple[Curve, ...] = ()
        self._curves_of: tuple[str, str] = ("", "")
        self._busy = asyncio.Lock()
        with ui.card().classes("w-full"):
            with ui.row().classes("items-end w-full"):
                ui.label("Thrust ratio").classes("card-title grow")
                self._basis = ui.select(AT, value=RATIO_BASES[0], label="At")
                self._basis.classes("w-36")
                models = {"": "no model", **{name: name for name in model_names()}}
                self._model = ui.select(models, value="", label="Model and its band")
                self._model.classes("w-52").mark("model")
            self._plot = RatioPlot(nothing_yet(context.bench))

    async def refresh(self) -> None:
        """Draw anew when there is something new."""
        if self._busy.locked():
            return
        async with self._busy:
            await self._refresh()

    async def _refresh(self) -> None:
        bench = self._context.bench
        rig, swept = bench.connection.rig, bench.swept
        if rig is not None and rig.name != self._rig_name:
            self._rig_name = rig.name
            self._model.value = STANDARD.get(rig.n_discs, "")
        dark = self._context.dark
        wanted = (
            swept.run,
            swept.done,
            rig.name if rig else "",
            self._model.value,
            self._basis.value,
            dark,
            nothing_yet(bench),
        )
        if wanted == self._shown:
            return
        self._shown = wanted
        points = Points()
        worker = self._context.worker(WORKER)
        if swept.run and swept.done and not swept.pitch:
            points = await worker.run(measured_points, Path(swept.run), self._basis.value)
        if rig is not None and self._curves_of != (rig.name, self._model.value):
            self._curves_of = rig.name, self._model.value
            self._curves, why = await self._curves_for(rig)
            points = points if points.rows else Points(why=why)
        self._plot.show(points, self._curves, empty=nothing_yet(bench), dark=dark)

    async def _curves_for(self, rig: Rig) -> tuple[tuple[Curve, ...], str]:
        worker = self._context.worker(WORKER)
        try:
            return await worker.run(model_curves, self._model.value, rig, SPAN), ""
        except BenchtoolError as error:
            return await worker.run(model_curves, "", rig, SPAN), str(error)


def nothing_yet(bench: BenchLink) -> str:
    """Return what an empty plot says."""
    if bench.swept.active and not bench.swept.pitch:
        return "The sweep runs; its points come here as they are measured."
    if bench.connection.status == "on":
        return "Start a sweep: its points come here as they are measured."
    return "Connect a bench under Bench, then start a sweep:<br>its points come here."
