"""T_IGE/T_OGE over plate distance, points as they are measured, over a model and its band."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from nicegui import ui

from benchtool.core.errors import BenchtoolError
from benchtool.data.run.ratios import RATIO_BASES
from benchtool.physics.model_file import model_names
from benchtool.report.palette import GREY, SERIES_STYLES, VERMILION
from benchtool.web.bench_process.client import BenchClient
from benchtool.web.context import PageContext
from benchtool.web.tabs.sweep.work import MeasuredRatios, Trace, measured_ratios, model_curves
from benchtool.web.theme import LIGHT_INK

BASES = {"equal_rpm2": "equal rpm²", "equal_pwm": "equal pulse", "equal_power": "equal power"}
"""What is held equal, in words."""

assert tuple(BASES) == RATIO_BASES

STANDARD = {1: "single_bench", 4: "quad_bench"}  # Model that is shown first, by the number of discs

SPAN = (0.5, 5.0)  # z/R of the curves
_STAMP = {
    "text": "<b>SIMULATED</b>", "xref": "paper", "yref": "paper", "x": 0.01, "y": 0.01,
    "showarrow": False, "font": {"color": VERMILION, "size": 13},
    "bordercolor": VERMILION, "borderwidth": 1, "borderpad": 3,
}  # fmt: skip
"""Marks a figure of simulated data, as every figure of the project does."""

_EMPTY = {
    "xref": "paper", "yref": "paper", "x": 0.5, "y": 0.5, "showarrow": False, "font": {"size": 15},
}  # fmt: skip
"""Stands in a plot that has nothing to show."""


class RatioCard:
    """Show the ratios of the present run over a model of choice."""

    def __init__(self, context: PageContext) -> None:
        self._context = context
        self._shown: tuple[object, ...] = ()
        self._rig_name = ""
        self._curves: tuple[Trace, ...] = ()
        self._curves_of: tuple[str, ...] = ()
        self._busy = asyncio.Lock()
        with ui.card().classes("w-full"):
            with ui.row().classes("items-end w-full"):
                ui.label("Thrust").classes("card-title grow")
                self._basis = ui.select(BASES, value=RATIO_BASES[0], label="At")
                self._basis.classes("w-36")
                models = {"": "no model", **{name: name for name in model_names()}}
                self._model = ui.select(models, value="", label="Model and its band")
                self._model.classes("w-52")
            figure = ratio_figure(MeasuredRatios(), (), empty_figure(context.bench), GREY)
            self._plot = ui.plotly(figure).classes("w-full ratio-plot")
            self._why = ui.label().classes("soft")

    async def refresh(self) -> None:
        if self._busy.locked():
            return
        async with self._busy:
            await self._refresh()

    async def _refresh(self) -> None:
        bench = self._context.bench
        rig, sweep = bench.connection.rig, bench.sweep
        ink = LIGHT_INK if self._context.dark else SERIES_STYLES["measurement"].color
        if rig is not None and rig.name != self._rig_name:
            self._rig_name = rig.name
            self._model.value = STANDARD.get(rig.n_discs, "")
        model, basis, empty = self._model.value, self._basis.value, empty_figure(bench)
        wanted = (sweep.run, sweep.done, rig.name if rig else "", model, basis, ink, empty)
        if wanted == self._shown:
            return
        self._shown = wanted
        worker = self._context.worker("plots")
        points = MeasuredRatios()
        if sweep.run and sweep.done and sweep.kind != "pitch":
            points = await worker.run(measured_ratios, Path(sweep.run), basis)
        if rig is not None and self._curves_of != (rig.name, model, ink, basis):
            self._curves_of = rig.name, model, ink, basis
            try:
                self._curves = await worker.run(model_curves, model, rig, SPAN, ink, basis)
            except BenchtoolError as error:
                self._curves = await worker.run(model_curves, "", rig, SPAN, ink, basis)
                points = points if points.rows else MeasuredRatios(why=str(error))
        self._plot.update_figure(ratio_figure(points, self._curves, empty, ink))
        self._why.set_text(points.why)
        self._why.set_visibility(bool(points.why))


def empty_figure(bench: BenchClient) -> str:
    """Return the text of an empty plot."""
    if bench.sweep.active and bench.sweep.kind == "sweep":
        return "The sweep runs; its points come here as they are measured."
    if bench.connection.status == "on":
        return "Start a sweep: its points come here as they are measured."
    return "Connect a bench under Bench, then start a sweep:<br>its points come here."


def ratio_figure(
    points: MeasuredRatios, curves: Sequence[Trace], empty_text: str, ink: str
) -> dict[str, Any]:
    """Return the figure as Plotly takes it."""
    x, y, error = map(list, zip(*points.rows, strict=True)) if points.rows else ([], [], [])
    measured = {
        "type": "scatter", "mode": "markers", "name": "measured", "x": x, "y": y,
        "error_y": {"type": "data", "array": error, "color": ink, "thickness": 1.2},
        "marker": {"color": ink, "size": 7, "symbol": "circle-open"},
    }  # fmt: skip
    empty = not points.rows and not curves
    x_title, y_title = "z / R", "T<sub>IGE</sub> / T<sub>OGE</sub>"
    if points.raw:
        curves, x_title, y_title = (), "pulse, us", "thrust, N"
    axis = {"gridcolor": GREY + "44", "zeroline": False, "linecolor": GREY, "visible": not empty}
    # Thrust rises with the pulse, ratios fall with the distance: one corner is free.
    stamp = {**_STAMP, "y": 0.99} if points.raw else _STAMP
    notes = [stamp] if points.simulated else [{**_EMPTY, "text": empty_text}] if empty else []
    return {
        "data": [*curves, measured],
        "layout": {
            "height": 420,
            "margin": {"l": 60, "r": 16, "t": 12, "b": 46},
            "paper_bgcolor": "rgba(0,0,0,0)",
            "plot_bgcolor": "rgba(0,0,0,0)",
            "font": {"color": ink, "family": "Roboto, sans-serif", "size": 13},
            "xaxis": {**axis, "title": {"text": x_title}},
            "yaxis": {**axis, "title": {"text": y_title}},
            "legend": {"x": 0.98, "xanchor": "right", "y": 0.98},
            "uirevision": x_title,
            "annotations": notes,
        },
        "config": {"displayModeBar": False, "responsive": True},
    }
