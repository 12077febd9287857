"""Web application: page with STOP in its header, and tabs built when first shown.

`serve` imports this module last, as the web framework is slow to import.
"""

from __future__ import annotations

import asyncio
import os
import socket
from importlib import import_module
from pathlib import Path
from time import monotonic

import uvicorn
from fastapi import FastAPI, Request
from fastapi.middleware.gzip import GZipMiddleware
from nicegui import app, ui

from benchtool.acquire.visit_order import format_duration
from benchtool.web.access import Access, AccessMiddleware
from benchtool.web.bench_process.client import BenchClient
from benchtool.web.bench_process.messages import SPEED_LIMIT, Notice
from benchtool.web.bench_process.spawn import ProcessHandle
from benchtool.web.cards.live import reading_html
from benchtool.web.context import PageContext, ServerState
from benchtool.web.sockets import add_control_script, serve_control_sockets, serve_stream
from benchtool.web.theme import STATIC, apply_theme
from benchtool.web.widgets import notify, notify_all_pages, notify_error, open_dialog, show_errors

RECONNECT_TIMEOUT_S = 15.0  # a page disconnected for longer is dropped; assumed
MAX_MESSAGE_BYTES = 1_000_000  # of a websocket; files are uploaded by requests


def run_application(
    runs: Path, listening: socket.socket, access: Access, process: ProcessHandle
) -> None:
    """Serve the page until Ctrl-C."""
    port = listening.getsockname()[1]
    server = ServerState(runs=runs, bench=BenchClient(process), stop_endpoint=process.stop_endpoint)

    def show_notice(notice: Notice) -> None:
        server.log.add(notice.text, is_error=notice.is_error)
        notify_all_pages(notice)

    server.bench.on_notice = show_notice
    server.bench.on_alarm = lambda text: server.log.add(text, is_error=True)
    app.on_startup(server.bench.start)
    app.on_shutdown(server.close)
    app.on_exception(notify_error)
    app.add_static_files("/static", STATIC)
    serve_control_sockets(server)
    serve_stream(server.bench)
    serve_page(server)
    # NiceGUI behaves differently if this is set.
    os.environ.pop("PYTEST_CURRENT_TEST", None)
    guarded = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    guarded.add_middleware(
        AccessMiddleware, access=access, cookie=f"benchtool-{port}",
        stop_port=process.stop_endpoint.port if process.stop_endpoint else None,
    )  # fmt: skip
    # Quasar's loading bar has no accessible name and is in no landmark.
    app.config.quasar_config["loadingBar"]["skipHijack"] = True
    ui.run_with(
        guarded, title="benchtool", show_welcome_message=False,
        reconnect_timeout=RECONNECT_TIMEOUT_S, language="en-US", tailwind=False,
        # On the loopback interface, compression costs more time than it saves.
        gzip_middleware_factory=None if access.token is None else GZipMiddleware,
    )  # fmt: skip
    config = uvicorn.Config(
        guarded, log_level="warning", ws="wsproto", ws_max_size=MAX_MESSAGE_BYTES
    )
    uvicorn.Server(config).run(sockets=[listening])


TABS = {
    "Bench": "speed",
    "Sweep": "stacked_line_chart",
    "Runs": "folder_open",
    "Fit": "functions",
    "Simulate": "flight_takeoff",
    "Explain": "troubleshoot",
}
"""Tabs in order with Material icons; module `tabs/NAME.py`, imported when first shown."""


def serve_page(server: ServerState) -> None:
    """Serve the page under /; ?tab=NAME selects the tab."""

    @ui.page("/", title="benchtool")
    def page(request: Request, tab: str = "") -> None:
        theme = request.cookies.get("benchtool-theme", "")
        context = PageContext(server=server, theme=theme if theme in ("light", "dark") else "")
        add_control_script(context)
        header = Header(context, apply_theme(theme))
        keys = [name.lower() for name in TABS]
        initial_key, tabs = tab if tab in keys else keys[0], header.tabs
        with tabs:
            for name, icon in TABS.items():
                ui.tab(name.lower(), label=name, icon=icon)
        with ui.tab_panels(tabs, value=initial_key, animated=False, keep_alive=True).classes(
            "w-full bg-transparent"
        ):
            panels = {key: ui.tab_panel(key).classes("w-full") for key in keys}
        built: set[str] = set()

        def show(key: str) -> None:
            if key not in built:
                built.add(key)
                with panels[key]:
                    import_module(f"benchtool.web.tabs.{key}").build(context)

        async def select(key: str) -> None:
            ui.run_javascript(
                f'history.replaceState(null, "", "?tab={key}"); window.scrollTo(0, 0)'
            )
            # In a thread, as heartbeats of pages must not wait for an import.
            await asyncio.to_thread(import_module, f"benchtool.web.tabs.{key}")
            show(key)

        tabs.on_value_change(lambda change: select(str(change.value)))
        show(initial_key)


STOP = (
    '<button class="stop-button" type="button" aria-keyshortcuts="Space Escape">STOP'
    "<small>space bar or Esc</small></button>"
    '<span class="stop-note warn-box" role="alert"></span>'
)

ZERO_THROTTLE_TEXT = "motors at zero"

REFRESH_INTERVAL_S = 0.25

_THEMES = {"": ("brightness_auto", "light"), "light": ("light_mode", "dark"),
           "dark": ("dark_mode", "")}  # fmt: skip


class Header:
    """Header with tabs, status line, STOP, alarm banner and readings."""

    def __init__(self, context: PageContext, dark: ui.dark_mode) -> None:
        self._context, self._dark = context, dark
        self._title = "benchtool"
        with ui.header():
            with ui.element("div").classes("header-grid"):
                ui.label("benchtool").classes("page-name").props("role=heading aria-level=1")
                self.tabs = ui.tabs().props("dense no-caps inline-label align=left")
                with ui.row().classes("status-line"):
                    self._state = ui.label().props("role=status")
                    self._control = ui.label().classes("soft")
                    self._take_button = ui.button("Take over", on_click=self._take_over)
                    self._take_button.props("outline dense")
                with ui.row(wrap=False).classes("header-tools gap-1"):
                    self._connection = ui.button(icon="usb", on_click=self._show_connection)
                    self._connection.props('aria-label="Connection"')
                    self._theme = ui.button(on_click=self._next_theme)
                    self._theme.props('aria-label="Theme: light, dark or system setting"')
                    log = ui.button(icon="history", on_click=self._show_log)
                    log.props('aria-label="Messages"')
                    for button in (self._connection, self._theme, log):
                        button.props("flat round dense")
                ui.html(STOP, sanitize=False).classes("stop-place")
                self._known = ui.label().classes("known hidden")
            with ui.row(wrap=False).classes("alarm items-center") as self._alarm:
                self._cause = ui.label().classes("grow").props("role=alert")
                self._dismiss = ui.button(on_click=self._dismiss_alarm).props("outline")
            self._readings = ui.html(sanitize=False).classes("readings")
        self._show_theme()
        self.refresh()
        context.on_connect = self.refresh
        ui.timer(REFRESH_INTERVAL_S, self.refresh)

    def refresh(self) -> None:
        limits = self._context.bench.live.limits
        self._readings.set_visibility(bool(limits))
        self._readings.set_content("".join(map(reading_html, limits)))
        connection = self._context.bench.connection
        parts, in_control = status_parts(self._context.bench), self._context.in_control()
        self._known.set_text(f"{', '.join(parts)}.")
        self._state.set_text(" · ".join(parts))
        self._control.set_text("this page controls" if in_control else "watching, another controls")
        motors = motors_text(self._context.bench)
        title = "benchtool" if motors == ZERO_THROTTLE_TEXT else f"{motors} – benchtool"
        if title != self._title:
            self._title = title
            with self._state:  # also called from a websocket's task
                ui.page_title(title)
        may_turn = bool(connection.standstill_problem)
        cause = connection.standstill_problem or connection.reason
        self._alarm.set_visibility(bool(cause))
        if may_turn and not cause.startswith("MOTORS MAY STILL TURN"):
            cause = f"MOTORS MAY STILL TURN: {cause}"
        self._cause.set_text(cause)
        self._alarm.classes(**{"add" if may_turn else "remove": "motors"})
        self._connection.set_visibility(connection.status == "on")
        self._dismiss.set_text("I checked: motors at standstill" if may_turn else "Dismiss")
        is_free = self._context.server.control.is_free(monotonic())
        self._take_button.set_visibility(is_free and not in_control and bool(self._context.tab))

    def _show_connection(self) -> None:
        self._context.shows_connection = not self._context.shows_connection
        self.tabs.set_value("bench")

    def _take_over(self) -> None:
        has_lock = self._context.server.control.acquire(self._context.tab, monotonic())
        notify("this page has the control lock" if has_lock else "another page has taken over")
        self.refresh()

    @show_errors
    def _dismiss_alarm(self) -> None:
        self._context.require_control()
        self._context.bench.dismiss_alarm()
        self.refresh()

    def _show_log(self) -> None:
        with open_dialog("Messages") as dialog:
            lines = [
                f"{message.time:%H:%M:%S}  {'! ' if message.is_error else ''}{message.text}"
                + (f" ({message.count} times)" if message.count > 1 else "")
                for message in reversed(self._context.server.log.messages)
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
    """Return one phrase each about bench, motors, arming and run."""
    connection, live, sweep = bench.connection, bench.live, bench.sweep
    parts = {
        "off": ["no bench is connected"],
        "opening": [f"opening {connection.address}"],
        "on": [connection.address, motors_text(bench), "armed" if live.armed else "not armed"],
    }[connection.status]
    if connection.standstill_problem:
        parts = [connection.standstill_problem]
    if sweep.status != "none":
        text = f"{sweep.noun} {sweep.name} {sweep.status}"
        if sweep.active and sweep.noun == "sweep":
            text += f", {sweep.n_measured} of {sweep.n_points} points"
        if sweep.active and sweep.remaining_s:
            text += f", about {format_duration(sweep.remaining_s)} left"
        parts.append(text)
    return parts


def motors_text(bench: BenchClient) -> str:
    """Return the highest commanded pulse width, and the highest measured speed if any."""
    command_us = max(bench.live.command_pwm_us, default=0.0)
    rig = bench.connection.rig
    if rig is None or command_us <= rig.propulsion.pwm_stop_us:
        return ZERO_THROTTLE_TEXT
    rpm = [limit.value for limit in bench.live.limits if limit.name == SPEED_LIMIT]
    return f"motors at {command_us:.0f} us" + "".join(f", {value:.0f} rpm" for value in rpm)
