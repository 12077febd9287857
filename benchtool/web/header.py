"""What is always on the screen: Stop, the state of the bench, who is at the controls."""

from __future__ import annotations

from time import monotonic

from nicegui import ui

from benchtool.web.bench_process.client import BenchClient
from benchtool.web.context import PageContext
from benchtool.web.widgets import notify, open_dialog, shows_errors

STOP = (
    '<button class="stop-button" type="button" aria-keyshortcuts="Space Escape">STOP'
    "<small>space bar or Esc</small></button>"
    '<span class="stop-note" role="alert"></span>'
)

LOOK_S = 0.5

_THEMES = {"": ("brightness_auto", "light"), "light": ("light_mode", "dark"),
           "dark": ("dark_mode", "")}  # fmt: skip


class Header:
    """Show the top of the page."""

    def __init__(self, context: PageContext, dark: ui.dark_mode) -> None:
        self._context, self._dark = context, dark
        with ui.header().classes("q-py-xs q-px-md"):
            with ui.row(wrap=False).classes("items-center w-full gap-4"):
                ui.label("benchtool").classes("text-h6 page-name").props(
                    "role=heading aria-level=1"
                )
                with ui.column().classes("grow gap-0 min-w-0"):
                    self._state = ui.label().classes("ellipsis w-full").props("role=status")
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
        ui.timer(LOOK_S, self.refresh)

    def refresh(self) -> None:
        connection = self._context.bench.connection
        words = {"off": "no bench", "opening": f"opening {connection.address}"}
        self._state.set_text(words.get(connection.status, connection.address))
        self._known.set_text(known(self._context.bench))
        cause, motors = connection.unseen or connection.reason, bool(connection.unseen)
        self._alarm.set_visibility(bool(cause))
        if motors and not cause.startswith("MOTORS MAY STILL TURN"):
            cause = f"MOTORS MAY STILL TURN: {cause}"
        self._cause.set_text(cause)
        self._alarm.classes(**{"add" if motors else "remove": "motors"})
        self._dismiss.set_text("I have looked: they stand" if motors else "Dismiss")
        in_control = self._context.in_control()
        self._control.set_text("at the controls" if in_control else "watching")
        free = self._context.server.control.is_free(monotonic())
        self._take.set_visibility(free and not in_control and bool(self._context.tab))

    def _take_over(self) -> None:
        taken = self._context.server.control.take(self._context.tab, monotonic())
        notify("this page is at the controls now" if taken else "another page was faster")
        self.refresh()

    @shows_errors
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


def known(bench: BenchClient) -> str:
    """Return what is known of motors and run, for a page that loses its server."""
    if bench.connection.unseen:
        motors = bench.connection.unseen
    elif bench.connection.status == "off":
        motors = "no bench is connected"
    elif bench.live.pulses_us:
        motors = f"{bench.connection.address}, motors ordered to {max(bench.live.pulses_us):.0f} us"
    else:
        motors = f"{bench.connection.address}, motors not ordered to turn"
    sweep = bench.sweep
    if sweep.status == "none":
        return f"{motors}."
    done = f", {sweep.done} of {sweep.visits} visits" if sweep.what == "sweep" else ""
    return f"{motors}; {sweep.what} {sweep.run} {sweep.status}{done}."
