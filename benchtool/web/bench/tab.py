"""The Bench tab: connect, see it live, tare, calibrate, record pitch, turn motors by hand."""

from __future__ import annotations

from nicegui import ui

from benchtool.web.bench.connect_card import ConnectCard
from benchtool.web.bench.device_card import DeviceCard
from benchtool.web.bench.limits_card import LimitsCard
from benchtool.web.bench.load_cell_card import LoadCellCard
from benchtool.web.bench.record_card import RecordCard
from benchtool.web.bench.throttle_card import ThrottleCard
from benchtool.web.context import Context
from benchtool.web.strip_chart import StripChart, panels_of

LOOK_S = 0.25
"""How often the numbers beside the charts are looked at."""


def build(context: Context) -> None:
    """Make the tab."""
    shown = -1
    with ui.element("div").classes("grid-main"):
        with ui.element("div"):
            connect = ConnectCard(context)
            record = RecordCard(context)
            charts = ui.card().classes("w-full").mark("charts")
        with ui.element("div"):
            throttle = ThrottleCard(context)
            limits = LimitsCard(context)
            cell = LoadCellCard(context)
            device = DeviceCard(context)

    def refresh() -> None:
        nonlocal shown
        connection = context.bench.connection
        for card in (connect, record, throttle, limits, cell, device):
            card.refresh()
        session = connection.session if connection.identity is not None else 0
        if session != shown:
            shown = session
            charts.clear()
            charts.set_visibility(connection.identity is not None)
            if connection.identity is not None:
                with charts:
                    StripChart(session, panels_of(connection.identity.channels))

    refresh()
    ui.timer(LOOK_S, refresh)
