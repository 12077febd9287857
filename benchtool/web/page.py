"""The one page: a header with Stop, and tabs that are built when they are first shown."""

from __future__ import annotations

from importlib import import_module

from fastapi import Request
from nicegui import ui

from benchtool.web.context import PageContext, ServerState
from benchtool.web.control_socket import add_control_line
from benchtool.web.header import Header
from benchtool.web.theme import apply_theme

TABS = {
    "Bench": "speed",
    "Sweep": "stacked_line_chart",
    "Runs": "folder_open",
    "Fit": "functions",
    "Simulate": "flight_takeoff",
    "Explain": "troubleshoot",
}
"""Tabs in order, with their Material icons. A tab is `tabs/NAME/tab.py` with a function
`build(context)` that makes its elements in the present slot; it is imported when the tab is first
shown, so that a page is usable before the libraries of every tab are there."""

# Loads the plots' library before STOP is drawn.
EARLY = '<script type="module">import "nicegui-plotly";</script>'


def serve_page(server: ServerState) -> None:
    """Offer the page under /; ?tab=NAME opens it on a tab."""

    @ui.page("/", title="benchtool")
    def page(request: Request, tab: str = "") -> None:
        theme = request.cookies.get("benchtool-theme", "")
        context = PageContext(server=server, theme=theme if theme in ("light", "dark") else "")
        add_control_line(context)
        ui.add_head_html(EARLY)
        header = Header(context, apply_theme(theme))
        keys = [name.lower() for name in TABS]
        with header.tabs_place:
            first = tab if tab in keys else keys[0]
            tabs = ui.tabs()
            tabs.props("dense no-caps inline-label align=left").classes("w-full")
        with tabs:
            for name, icon in TABS.items():
                ui.tab(name.lower(), label=name, icon=icon)
        with ui.tab_panels(tabs, value=first, animated=False, keep_alive=True).classes("w-full"):
            panels = {key: ui.tab_panel(key).classes("w-full") for key in keys}
        built: set[str] = set()

        def show(key: str) -> None:
            if key not in built:
                built.add(key)
                with panels[key]:
                    import_module(f"benchtool.web.tabs.{key}.tab").build(context)

        def chosen(key: str) -> None:
            show(key)
            ui.run_javascript(
                f'history.replaceState(null, "", "?tab={key}"); window.scrollTo(0, 0)'
            )

        tabs.on_value_change(lambda change: chosen(str(change.value)))
        show(first)
