"""Bench tab: connection, live charts, tare, calibration, recordings and manual throttle."""

from __future__ import annotations

from nicegui import ui

from benchtool.web.context import PageContext
from benchtool.web.tabs.bench.charts import ChartCard
from benchtool.web.tabs.bench.connect_card import ConnectCard
from benchtool.web.tabs.bench.limits_card import LimitsCard
from benchtool.web.tabs.bench.manual_cards import LoadCellCard, ThrottleCard
from benchtool.web.tabs.bench.record_card import LiveRecordCard, RecordCard
from benchtool.web.widgets import show_facts, titled_card

REFRESH_INTERVAL_S = 0.25  # of the numbers


class DeviceCard:
    """Device information and link quality."""

    def __init__(self, context: PageContext) -> None:
        self._context = context
        self._session = -1
        with titled_card("Link and device") as self._card:
            self._link = ui.label().classes("number")
            self._facts = ui.element("div").classes("facts-grid")

    def refresh(self) -> None:
        connection, live = self._context.bench.connection, self._context.bench.live
        identity, rig = connection.identity, connection.rig
        self._card.set_visibility(identity is not None)
        if identity is None:
            return
        self._link.set_text(
            f"{live.rate_Hz:.0f} samples/s of {identity.rate_Hz:g}; {live.samples} received, "
            f"{live.lost} lost, {live.corrupt} corrupt"
        )
        self._link.classes(**({"add": "warn"} if live.lost else {"remove": "warn"}))
        if connection.session == self._session:
            return
        self._session = connection.session
        facts = {
            "device": identity.device_id + (" (virtual)" if identity.simulated else ""),
            "firmware": identity.firmware,
            "protocol": identity.protocol,
            "rig": f"{rig.name}: {rig.title}" if rig else "",
            "plate": "moved by the device" if identity.moves_plate else "not moved by the device",
            "watchdog": f"{1e3 * identity.watchdog_s:.0f} ms",
            "channels": ", ".join(channel.name for channel in identity.channels),
            **{name: text for name, text in identity.facts.items() if name == "warning"},
        }
        show_facts(self._facts, facts)


def build(context: PageContext) -> None:
    """Build the tab."""
    with ui.element("div").classes("grid-main"):
        with ui.element("div"):
            connect = ConnectCard(context)
            record = RecordCard(context)
            live = LiveRecordCard(context)
            charts = ChartCard(context)
        with ui.element("div"):
            throttle = ThrottleCard(context)
            limits = LimitsCard(context)
            load_cell = LoadCellCard(context)
            device = DeviceCard(context)

    def refresh() -> None:
        for card in (connect, record, live, charts, throttle, limits, load_cell, device):
            card.refresh()

    refresh()
    ui.timer(REFRESH_INTERVAL_S, refresh)
