"""The one page: a header with Stop, and tabs that are built when they are first shown."""

from __future__ import annotations

from fastapi import Request
from nicegui import ui

from benchtool.web.context import Context, Shared
from benchtool.web.control_line import add_control_line
from benchtool.web.header import Header
from benchtool.web.tab import Tab
from benchtool.web.tabs import TABS
from benchtool.web.theme import dress_page

EARLY = '<script type="module">import "nicegui-plotly";</script>'
"""Runs the plots' library, a second of a busy main thread, before STOP is there to be pressed."""


def serve_page(shared: Shared) -> None:
    """Offer the page under /; ?tab=NAME opens it on a tab."""

    @ui.page("/", title="benchtool")
    def page(request: Request, tab: str = "") -> None:
        theme = request.cookies.get("benchtool-theme", "")
        context = Context(shared=shared, theme=theme if theme in ("light", "dark") else "")
        add_control_line(context)
        ui.add_head_html(EARLY)
        header = Header(context, dress_page(theme))
        keys = [one.key for one in TABS]
        with header.tabs_place:
            first = tab if tab in keys else keys[0]
            tabs = ui.tabs()
            tabs.props("dense no-caps inline-label align=left").classes("w-full")
        with tabs:
            for one in TABS:
                ui.tab(one.key, label=one.name, icon=one.icon)
        with ui.tab_panels(tabs, value=first, animated=False, keep_alive=True).classes("w-full"):
            panels = {one.key: ui.tab_panel(one.key).classes("w-full") for one in TABS}
        built: set[str] = set()

        def show(key: str) -> None:
            if key not in built:
                built.add(key)
                with panels[key]:
                    _tab(key).build(context)

        def chosen(key: str) -> None:
            show(key)
            ui.run_javascript(
                f'history.replaceState(null, "", "?tab={key}"); window.scrollTo(0, 0)'
            )

        tabs.on_value_change(lambda change: chosen(str(change.value)))
        show(first)


def _tab(key: str) -> Tab:
    return next(one for one in TABS if one.key == key)
