"""What is always on the screen: Stop, the state of the bench, who is at the controls."""

from __future__ import annotations

from time import monotonic

from nicegui import ui

from benchtool.web.bench_process.client import BenchClient
from benchtool.web.context import PageContext
from benchtool.web.widgets import notify, shows_errors

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
                self._state = ui.label().classes("grow ellipsis").props("role=status")
                self._control = ui.label().classes("soft gt-sm")
                self._take = ui.button("Take over", on_click=self._take_over).props("outline")
                self._theme = ui.button(on_click=self._next_theme).props("flat round dense")
                self._theme.props('aria-label="Light, dark, or as the system has it"')
                ui.html(STOP, sanitize=False)
                self._known = ui.label().classes("known")
            with ui.row(wrap=False).classes("danger items-center w-full") as self._danger:
                self._unseen = ui.label().classes("grow").props("role=alert")
                ui.button("I have looked: they stand", on_click=self._seen).props(
                    "outline color=white"
                )
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
        unseen = connection.unseen
        self._danger.set_visibility(bool(unseen))
        if unseen and not unseen.startswith("MOTORS MAY STILL TURN"):
            unseen = f"MOTORS MAY STILL TURN: {unseen}"
        self._unseen.set_text(unseen)
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
        self._context.bench.confirm_standstill()
        self.refresh()

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
