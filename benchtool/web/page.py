"""Page with the header and tabs that are built when first shown."""

from __future__ import annotations

from importlib import import_module

from fastapi import Request
from nicegui import ui

from benchtool.web.context import PageContext, ServerState
from benchtool.web.control_socket import add_control_script
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
"""Tabs in order with Material icons; module `tabs/NAME/tab.py`, imported when first shown."""

# Loads the plot library before STOP is drawn.
PLOT_PRELOAD = '<script type="module">import "nicegui-plotly";</script>'


def serve_page(server: ServerState) -> None:
    """Serve the page under /; ?tab=NAME selects the tab."""

    @ui.page("/", title="benchtool")
    def page(request: Request, tab: str = "") -> None:
        theme = request.cookies.get("benchtool-theme", "")
        context = PageContext(server=server, theme=theme if theme in ("light", "dark") else "")
        add_control_script(context)
        ui.add_head_html(PLOT_PRELOAD)
        header = Header(context, apply_theme(theme))
        keys = [name.lower() for name in TABS]
        with header.tab_row:
            initial_key = tab if tab in keys else keys[0]
            tabs = ui.tabs()
            tabs.props("dense no-caps inline-label align=left").classes("w-full")
        with tabs:
            for name, icon in TABS.items():
                ui.tab(name.lower(), label=name, icon=icon)
        with ui.tab_panels(tabs, value=initial_key, animated=False, keep_alive=True).classes(
            "w-full"
        ):
            panels = {key: ui.tab_panel(key).classes("w-full") for key in keys}
        built: set[str] = set()

        def show(key: str) -> None:
            if key not in built:
                built.add(key)
                with panels[key]:
                    import_module(f"benchtool.web.tabs.{key}.tab").build(context)

        def select(key: str) -> None:
            show(key)
            ui.run_javascript(
                f'history.replaceState(null, "", "?tab={key}"); window.scrollTo(0, 0)'
            )

        tabs.on_value_change(lambda change: select(str(change.value)))
        show(initial_key)
