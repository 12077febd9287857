"""What is always on the screen: Stop, the state of the bench, who is at the controls."""

from __future__ import annotations

from pathlib import Path
from time import monotonic

from nicegui import ui

from benchtool.acquire.visit_order import minutes
from benchtool.web.bench_process.client import BenchClient
from benchtool.web.bench_process.messages import SPEED_LIMIT
from benchtool.web.context import PageContext
from benchtool.web.widgets import notify, open_dialog, show_errors

STOP = (
    '<button class="stop-button" type="button" aria-keyshortcuts="Space Escape">STOP'
    "<small>space bar or Esc</small></button>"
    '<span class="stop-note" role="alert"></span>'
)

STANDING = "motors at zero"

REFRESH_INTERVAL_S = 0.5

_THEMES = {"": ("brightness_auto", "light"), "light": ("light_mode", "dark"),
           "dark": ("dark_mode", "")}  # fmt: skip


class Header:
    """Show the top of the page."""

    def __init__(self, context: PageContext, dark: ui.dark_mode) -> None:
        self._context, self._dark = context, dark
        self._title = "benchtool"
        with ui.header().classes("q-py-xs q-px-md"):
            with ui.row(wrap=False).classes("items-center w-full gap-4"):
                ui.label("benchtool").classes("text-h6 page-name").props(
                    "role=heading aria-level=1"
                )
                with ui.row().classes("status-line grow"):
                    self._state = ui.label().props("role=status")
                    self._control = ui.label().classes("soft")
                self._take = ui.button("Take over", on_click=self._take_over).props("outline")
                self._theme = ui.button(on_click=self._next_theme).props("flat round dense")
                self._theme.props('aria-label="Light, dark, or as the system has it"')
                log = ui.button(icon="history", on_click=self._show_log).props("flat round dense")
                log.props('aria-label="Messages"')
                ui.html(STOP, sanitize=False)
                self._known = ui.label().classes("known")
            with ui.row(wrap=False).classes("alarm items-center") as self._alarm:
                self._cause = ui.label().classes("grow").props("role=alert")
                self._dismiss = ui.button(on_click=self._seen).props("outline")
            self.tabs_place = ui.row().classes("w-full")
        self._show_theme()
        self.refresh()
        context.arrived = self.refresh
        ui.timer(REFRESH_INTERVAL_S, self.refresh)

    def refresh(self) -> None:
        connection = self._context.bench.connection
        parts, in_control = status_parts(self._context.bench), self._context.in_control()
        self._known.set_text(f"{', '.join(parts)}.")
        self._state.set_text(" · ".join(parts))
        self._control.set_text("at the controls" if in_control else "watching")
        motors = motors_text(self._context.bench)
        title = "benchtool" if motors == STANDING else f"{motors} – benchtool"
        if title != self._title:
            self._title = title
            with self._state:  # also called from a websocket's task
                ui.page_title(title)
        cause, unseen = connection.unseen or connection.reason, bool(connection.unseen)
        self._alarm.set_visibility(bool(cause))
        if unseen and not cause.startswith("MOTORS MAY STILL TURN"):
            cause = f"MOTORS MAY STILL TURN: {cause}"
        self._cause.set_text(cause)
        self._alarm.classes(**{"add" if unseen else "remove": "motors"})
        self._dismiss.set_text("I have looked: they stand" if unseen else "Dismiss")
        free = self._context.server.control.is_free(monotonic())
        self._take.set_visibility(free and not in_control and bool(self._context.tab))

    def _take_over(self) -> None:
        taken = self._context.server.control.take(self._context.tab, monotonic())
        notify("this page is at the controls now" if taken else "another page was faster")
        self.refresh()

    @show_errors
    def _seen(self) -> None:
        self._context.require_control()
        self._context.bench.dismiss_alarm()
        self.refresh()

    def _show_log(self) -> None:
        """Show what pages have shown, the newest first."""
        with open_dialog("Messages") as dialog:
            shown = reversed(self._context.server.log.messages)
            lines = [
                f"{one.at:%H:%M:%S}  {'! ' if one.is_error else ''}{one.text}"
                + (f" ({one.count} times)" if one.count > 1 else "")
                for one in shown
            ]
            ui.label("\n".join(lines) or "no message yet").classes("events w-full")
            ui.button("Close", on_click=dialog.close).props("outline")

    def _next_theme(self) -> None:
        theme = _THEMES[self._context.theme][1]
        self._context.theme = theme
        self._dark.value = {"light": False, "dark": True}.get(theme)
        cookie = f"benchtool-theme={theme}; path=/; max-age=31536000; samesite=strict"
        ui.run_javascript(f'document.cookie = "{cookie}"')
        self._show_theme()

    def _show_theme(self) -> None:
        self._theme.props(f"icon={_THEMES[self._context.theme][0]}")


def status_parts(bench: BenchClient) -> list[str]:
    """Return what is known of bench, motors and run, a phrase each."""
    connection, live, sweep = bench.connection, bench.live, bench.sweep
    parts = {
        "off": ["no bench is connected"],
        "opening": [f"opening {connection.address}"],
        "on": [connection.address, motors_text(bench), "armed" if live.armed else "not armed"],
    }[connection.status]
    if connection.unseen:
        parts = [connection.unseen]
    if sweep.status != "none":
        run = f"{sweep.what} {Path(sweep.run).name} {sweep.status}"
        if sweep.active:
            run += f", {sweep.done} of {sweep.visits} visits" if sweep.what == "sweep" else ""
            run += f", about {minutes(sweep.left_s)} left" if sweep.left_s else ""
        parts.append(run)
    return parts


def motors_text(bench: BenchClient) -> str:
    """Return the highest commanded pulse, with the highest speed where it is measured."""
    pulse_us = max(bench.live.pulses_us, default=0.0)
    rig = bench.connection.rig
    if rig is None or pulse_us <= rig.propulsion.pwm_stop_us:
        return STANDING
    rpm = [limit.value for limit in bench.live.limits if limit.name == SPEED_LIMIT]
    return f"motors at {pulse_us:.0f} us" + "".join(f", {value:.0f} rpm" for value in rpm)
