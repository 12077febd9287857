"""Sweep tab: plan with preview, control of the run and live plot."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from nicegui import ui

from benchtool.acquire.record import NO_PROGRESS
from benchtool.acquire.visit_order import format_duration
from benchtool.core.errors import BenchtoolError
from benchtool.data.run.ratios import RATIO_BASES
from benchtool.physics.model_file import model_names
from benchtool.report.palette import GREY, SERIES_STYLES
from benchtool.web import ratio_plot
from benchtool.web.bench_process.client import BenchClient
from benchtool.web.bench_process.messages import AnswerQuestion, PauseSweep
from benchtool.web.cards.live import ChartCard
from benchtool.web.cards.plan import PlanCard
from benchtool.web.context import PageContext
from benchtool.web.theme import LIGHT_INK
from benchtool.web.widgets import open_tab, refresh_cards, show_errors

REFRESH_INTERVAL_S = 0.5
MAX_EVENTS = 60


class RunCard:
    """Progress and control of the current or last sweep."""

    def __init__(self, context: PageContext) -> None:
        self._context = context
        send = show_errors(context.send)
        with ui.card().classes("w-full run-card") as self._card:
            with ui.row().classes("items-center w-full"):
                self._title = ui.label().classes("card-title grow")
                self._fit = ui.button("Fit", icon="functions").props("outline")
                self._fit.on_click(lambda: open_tab("fit", data=context.bench.sweep.name))
                self._pause = ui.button("Pause", icon="pause").props("outline")
                self._pause.on_click(lambda: send(PauseSweep(True)))
                self._continue = ui.button("Continue", icon="play_arrow")
                self._continue.on_click(lambda: send(PauseSweep(False)))
            self._bar = ui.linear_progress(show_value=False, size="12px")
            self._bar.props('instant-feedback aria-label="Share of measured points"')
            self._progress = ui.label().classes("number")
            self._reason = ui.label().classes("w-full")
            with ui.column().classes("w-full warn-box") as self._question_box:
                self._question = ui.label()
                with ui.row(wrap=False).classes("items-end w-full"):
                    self._answer = ui.input("Answer").classes("grow")
                    ui.button("Send", on_click=self._send)
            self._log = ui.label().classes("events w-full")

    def refresh(self) -> None:
        sweep, events = self._context.bench.sweep, self._context.bench.events
        self._card.set_visibility(sweep.status != "none" and sweep.kind == "sweep")
        self._title.set_text(f"{sweep.status}: {sweep.run}")
        self._pause.set_visibility(sweep.status == "running")
        self._continue.set_visibility(sweep.status in ("pausing", "paused"))
        self._fit.set_visibility(sweep.status == "ended")
        share = sweep.n_measured / sweep.n_points if sweep.n_points else 0.0
        self._bar.value = round(share, 3)
        text = f"{sweep.n_measured} of {sweep.n_points} points"
        text += f", about {format_duration(sweep.remaining_s)} left" if sweep.active else ""
        self._progress.set_text(f"{text} · {sweep.point_text}" if sweep.point_text else text)
        self._reason.set_text(sweep.reason)
        self._reason.set_visibility(bool(sweep.reason))
        is_warning = sweep.status == "stopped" or "not seen to stand" in sweep.reason
        self._reason.classes(**{"add" if is_warning else "remove": "warn-box"})
        self._question_box.set_visibility(bool(sweep.question))
        self._question.set_text(sweep.question)
        visible = [event for event in events if event.event not in NO_PROGRESS]
        lines = [f"{event.time_s:8.1f} s  {event.event}: {event.text}" for event in visible]
        text = "\n".join(reversed(lines[-MAX_EVENTS:]))
        self._log.set_text(text.replace("went_on: ", "").replace("paused: paused", "paused"))

    @show_errors
    def _send(self) -> None:
        self._context.send(AnswerQuestion(self._answer.value))
        self._answer.value = ""


BASES = {"equal_rpm2": "equal rpm²", "equal_pwm": "equal pulse", "equal_power": "equal power"}

assert tuple(BASES) == RATIO_BASES

DEFAULT_MODELS = {1: "single_bench", 4: "quad_bench"}  # by number of discs


class RatioCard:
    """Thrust ratios of the current run with a selected model."""

    def __init__(self, context: PageContext) -> None:
        self._context = context
        self._plot_key: tuple[object, ...] = ()
        self._rig_name = ""
        self._curves: tuple[ratio_plot.Trace, ...] = ()
        self._curves_key: tuple[str, ...] = ()
        with ui.card().classes("w-full"):
            with ui.row().classes("items-center w-full"):
                ui.label("Thrust").classes("card-title grow")
                self._basis = ui.select(BASES, value=RATIO_BASES[0], label="At")
                self._basis.props("dense").classes("w-44")
                models = {"": "no model", **{name: name for name in model_names()}}
                self._model = ui.select(models, value="", label="Model and its band")
                self._model.props("dense").classes("w-44")
            figure = ratio_plot.ratio_figure(
                ratio_plot.MeasuredRatios(), (), empty_text(context.bench), GREY
            )
            self._plot = ui.echart(figure).classes("w-full ratio-plot")
            self._plot.props('role=img aria-label="Thrust, no measured point"')
            self._problem = ui.label().classes("soft")

    async def refresh(self) -> None:
        bench = self._context.bench
        rig, sweep = bench.connection.rig, bench.sweep
        ink = LIGHT_INK if self._context.dark else SERIES_STYLES["measurement"].color
        if rig is not None and rig.name != self._rig_name:
            self._rig_name = rig.name
            self._model.value = DEFAULT_MODELS.get(rig.n_discs, "")
        model, basis, text = self._model.value, self._basis.value, empty_text(bench)
        rig_name = rig.name if rig else ""
        key = (sweep.run, sweep.n_measured, rig_name, model, basis, ink, text)
        if key == self._plot_key:
            return
        self._plot_key = key
        run = partial(self._context.server.run, "plots")
        points = ratio_plot.MeasuredRatios()
        if sweep.run and sweep.n_measured and sweep.kind != "pitch":
            points = await run(ratio_plot.measured_ratios, Path(sweep.run), basis)
        if rig is not None and self._curves_key != (rig.name, model, ink, basis):
            self._curves_key = rig.name, model, ink, basis
            try:
                self._curves = await run(ratio_plot.model_curves, model, rig, ink, basis)
            except BenchtoolError as error:
                self._curves = await run(ratio_plot.model_curves, "", rig, ink, basis)
                points = points if points.rows else ratio_plot.MeasuredRatios(problem=str(error))
        self._plot.options.update(ratio_plot.ratio_figure(points, self._curves, text, ink))
        self._plot.props(f'aria-label="Thrust, {len(points.rows)} measured points"')
        self._plot.update()
        self._problem.set_text(points.problem)
        self._problem.set_visibility(bool(points.problem))


def empty_text(bench: BenchClient) -> str:
    """Return the text of an empty plot."""
    if bench.sweep.active and bench.sweep.kind == "sweep":
        return "No point measured yet."
    if bench.connection.status == "on":
        return "Start a sweep to see its points here."
    return "Connect a bench under Bench, then start a sweep\nto see its points here."


def build(context: PageContext) -> None:
    """Build the tab."""
    with ui.element("div").classes("grid-main plan-left"):
        with ui.element("div"):
            run = RunCard(context)
            plot = RatioCard(context)
            charts = ChartCard(context, only=("Thrust", "Speed"))
        with ui.element("div"):
            plan = PlanCard(context)
    refresh_cards(REFRESH_INTERVAL_S, run, charts, plan)
    # Separate timer: the status of a sweep must not wait for its plot.
    ui.timer(REFRESH_INTERVAL_S, plot.refresh)
