"""Sweep tab: plan with preview, control of the run and live plot."""

from __future__ import annotations

from pathlib import Path

from nicegui import ui

from benchtool.acquire.visit_order import format_duration
from benchtool.web.bench_process.messages import AnswerQuestion, PauseSweep
from benchtool.web.context import PageContext
from benchtool.web.tabs.bench.charts import ChartCard
from benchtool.web.tabs.bench.limits_card import LimitsCard
from benchtool.web.tabs.sweep.plan_card import PlanCard
from benchtool.web.tabs.sweep.ratio_card import RatioCard
from benchtool.web.widgets import open_tab, show_errors

REFRESH_INTERVAL_S = 0.5
HIDDEN_EVENTS = frozenset({"device"})  # in the run folder only
MAX_EVENTS = 60


class RunCard:
    """Progress and control of the current or last sweep."""

    def __init__(self, context: PageContext) -> None:
        self._context = context
        self._n_events = -1
        with ui.card().classes("w-full run-card") as self._card:
            with ui.row().classes("items-center w-full"):
                self._title = ui.label().classes("card-title grow")
                self._fit = ui.button("Fit", icon="functions", on_click=self._open_fit)
                self._fit.props("outline")
                self._pause = ui.button(
                    "Pause", icon="pause", on_click=lambda: self._set_pause(on=True)
                )
                self._pause.props("outline")
                self._continue = ui.button(
                    "Continue", icon="play_arrow", on_click=lambda: self._set_pause(on=False)
                )
            self._bar = ui.linear_progress(show_value=False, size="12px")
            self._bar.props('instant-feedback aria-label="Share of measured points"')
            self._progress = ui.label().classes("number")
            self._reason = ui.label().classes("w-full")
            with ui.column().classes("w-full warn-box") as self._question_box:
                self._question = ui.label()
                with ui.row(wrap=False).classes("items-end w-full"):
                    self._answer = ui.input("Answer").classes("grow")
                    ui.button("Send", on_click=self._send)
            self._log = ui.column().classes("events w-full gap-0")
        self.refresh()

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
        self._progress.set_text(f"{text}  {sweep.point_text}")
        self._reason.set_text(sweep.reason)
        self._reason.set_visibility(bool(sweep.reason))
        is_warning = sweep.status == "stopped" or "not seen to stand" in sweep.reason
        self._reason.classes(**{"add" if is_warning else "remove": "warn-box"})
        self._question_box.set_visibility(bool(sweep.question))
        self._question.set_text(sweep.question)
        if len(events) != self._n_events:
            self._n_events = len(events)
            visible = [event for event in events if event.event not in HIDDEN_EVENTS]
            self._log.clear()
            with self._log:
                for event in reversed(visible[-MAX_EVENTS:]):
                    ui.label(f"{event.time_s:8.1f} s  {event.event}: {event.text}")

    def _open_fit(self) -> None:
        open_tab("fit", data=Path(self._context.bench.sweep.run).name)

    @show_errors
    def _set_pause(self, *, on: bool) -> None:
        self._context.send(PauseSweep(on))

    @show_errors
    def _send(self) -> None:
        self._context.send(AnswerQuestion(self._answer.value))
        self._answer.value = ""


def build(context: PageContext) -> None:
    """Build the tab."""
    with ui.element("div").classes("grid-main plan-left"):
        with ui.element("div"):
            run = RunCard(context)
            charts = ChartCard(context, ("Thrust", "Speed"), has_tools=False)
            limits = LimitsCard(context)
            plot = RatioCard(context)
        with ui.element("div"):
            plan = PlanCard(context)

    def refresh() -> None:
        for card in (run, charts, limits, plan):
            card.refresh()

    ui.timer(REFRESH_INTERVAL_S, refresh)
    # Separate timer: the status of a sweep must not wait for its plot.
    ui.timer(REFRESH_INTERVAL_S, plot.refresh)
