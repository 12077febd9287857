"""The tab Simulate: what is asked on the left, side views, charts and numbers on the right."""

from __future__ import annotations

from nicegui import ui

from benchtool.web.context import Context


def build(context: Context) -> None:
    """Make the tab's elements in the present slot."""
    from benchtool.web.simulate.desk import SimulateDesk

    ui.add_head_html('<link rel="stylesheet" href="/static/simulate.css">')
    SimulateDesk(context)
