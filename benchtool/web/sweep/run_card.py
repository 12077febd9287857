"""A sweep while it runs: how far, what is asked, pause, and what happened."""

from __future__ import annotations

from pathlib import Path
from urllib.parse import urlencode

from nicegui import ui

from benchtool.acquire.duration import minutes
from benchtool.web.context import Context
from benchtool.web.desk.asks import Answer, Pause
from benchtool.web.tell import tells_errors

QUIET = frozenset({"device"})
"""Events that the run folder keeps and the page does not show."""

SHOWN_EVENTS = 60


class RunCard:
    """Show and steer the sweep that runs, or the last one."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._events = -1
        with ui.card().classes("w-full run-card") as self._card:
            with ui.row().classes("items-center w-full"):
                self._title = ui.label().classes("card-title grow").mark("sweep-state")
                self._fit = ui.button("Fit", icon="functions", on_click=self._go_fit)
                self._fit.props("outline")
                self._pause = ui.button("Pause", icon="pause", on_click=lambda: self._wait(on=True))
                self._pause.props("outline")
                self._on = ui.button(
                    "Go on", icon="play_arrow", on_click=lambda: self._wait(on=False)
                )
            self._bar = ui.linear_progress(show_value=False, size="12px")
            self._bar.props('instant-feedback aria-label="Share of the visits that are measured"')
            self._now = ui.label().classes("number")
            self._reason = ui.label().classes("w-full").mark("reason")
            with ui.column().classes("w-full warn-box") as self._asking:
                self._question = ui.label()
                with ui.row(wrap=False).classes("items-end w-full"):
                    self._answer = ui.input("Answer").classes("grow")
                    ui.button("Send", on_click=self._send)
            self._log = ui.column().classes("events w-full gap-0")
        self.refresh()

    def refresh(self) -> None:
        """Show what is so now."""
        swept, events = self._context.bench.swept, self._context.bench.events
        self._card.set_visibility(swept.status != "none" and not swept.pitch)
        self._title.set_text(f"{swept.status}: {swept.run}")
        self._pause.set_visibility(swept.status == "running")
        self._on.set_visibility(swept.status in ("pausing", "paused"))
        self._fit.set_visibility(swept.status == "ended")
        self._bar.value = round(swept.done / swept.visits, 3) if swept.visits else 0.0
        left = f", about {minutes(swept.left_s)} left" if swept.active else ""
        self._now.set_text(f"{swept.done} of {swept.visits} visits{left}  {swept.now}")
        self._reason.set_text(swept.reason)
        self._reason.set_visibility(bool(swept.reason))
        stopped = swept.status == "stopped"
        warns = stopped or "not seen to stand" in swept.reason
        self._reason.classes(**{"add" if warns else "remove": "warn-box"})
        self._asking.set_visibility(bool(swept.question))
        self._question.set_text(swept.question)
        shown = [event for event in events if event.event not in QUIET][-SHOWN_EVENTS:]
        if len(events) != self._events:
            self._events = len(events)
            self._log.clear()
            with self._log:
                for event in reversed(shown):
                    ui.label(f"{event.time_s:8.1f} s  {event.event}: {event.text}")

    def _go_fit(self) -> None:
        name = Path(self._context.bench.swept.run).name
        ui.navigate.to(f"/?{urlencode({'tab': 'fit', 'data': name})}")

    @tells_errors
    def _wait(self, *, on: bool) -> None:
        self._context.need_control()
        self._context.bench.ask(Pause(on))

    @tells_errors
    def _send(self) -> None:
        self._context.need_control()
        self._context.bench.ask(Answer(self._answer.value))
        self._answer.value = ""
