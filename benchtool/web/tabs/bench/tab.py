"""The Bench tab: connect, see it live, tare, calibrate, record pitch, turn motors by hand."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence

from nicegui import ui
from nicegui.element import Element

from benchtool.core.channel import Channel
from benchtool.web.context import PageContext
from benchtool.web.tabs.bench.connect_card import ConnectCard
from benchtool.web.tabs.bench.manual_cards import LoadCellCard, ThrottleCard
from benchtool.web.tabs.bench.record_card import RecordCard
from benchtool.web.theme import STATIC, cycle
from benchtool.web.widgets import show_facts, titled_card

LOOK_S = 0.25
"""How often the numbers beside the charts are refreshed."""

CLOSE = 0.9
"""Share of a limit from which on its bar warns; a choice."""


SECONDS = 30.0
"""What the charts look back; a choice."""

STRIPS = (
    ("Thrust", "thrust_N", "N", 1.0, 3),
    ("Speed", "rpm", "rpm", 1.0, 0),
    ("Pulse", "pwm_us", "us", 1.0, 0),
    ("Plate distance", "plate_z_m", "mm", 1e3, 1),
    ("Pitch", "theta_rad", "deg", 57.29577951308232, 2),
    ("Voltage", "voltage_V", "V", 1.0, 2),
    ("Current", "current_A", "A", 1.0, 2),
)
"""Title, family of channels, unit shown, factor to it, decimals."""


class StripChart(Element, component=STATIC / "strip_chart.js"):
    """Show the live stream of one connection: one canvas, its ring buffer in the browser.

    Frames of another session are not shown.
    """

    def __init__(self, session: int, channels: Sequence[Channel]) -> None:
        super().__init__()
        names = [channel.name for channel in channels]
        panels = []
        for title, family, unit, factor, decimals in STRIPS:
            columns = [at for at, name in enumerate(names) if re.sub(r"\d", "", name) == family]
            lines = [
                {
                    "column": column,
                    "label": re.sub(r"\D", "", names[column]) if len(columns) > 1 else "",
                    "light": light,
                    "dark": dark,
                }
                for column, light, dark in zip(
                    columns,
                    itertools.cycle(cycle(dark=False)),
                    itertools.cycle(cycle(dark=True)),
                    strict=False,
                )
            ]
            if lines:
                panel = {"title": title, "unit": unit, "factor": factor, "decimals": decimals}
                panels.append({**panel, "lines": lines})
        self._props["session"] = session
        self._props["panels"] = panels
        self._props["seconds"] = SECONDS
        self.classes("w-full")


class LimitsCard:
    """Show how near every reading is to its limit, a bar for each."""

    def __init__(self, context: PageContext) -> None:
        self._context = context
        self._bars: dict[str, tuple[ui.linear_progress, ui.label]] = {}
        with titled_card("Limits") as self._card:
            self._rows = ui.column().classes("w-full gap-1")

    def refresh(self) -> None:
        limits = self._context.bench.live.limits
        self._card.set_visibility(bool(limits))
        if tuple(self._bars) != tuple(one.name for one in limits):
            self._rows.clear()
            self._bars.clear()
            with self._rows:
                for one in limits:
                    with ui.element("div").classes("near-row"):
                        ui.label(one.name)
                        bar = ui.linear_progress(show_value=False, size="10px")
                        bar.props(f'instant-feedback aria-label="{one.name}, share of its limit"')
                        self._bars[one.name] = bar, ui.label().classes("value number")
        for one in limits:
            bar, label = self._bars[one.name]
            bar.value = round(min(max(one.share, 0.0), 1.0), 3)
            bar.props(f"color={'warning' if one.share >= CLOSE else 'primary'}")
            label.set_text(f"{one.value:.4g} of {one.limit:g}")


class DeviceCard:
    """Show the device, what it streams, and the quality of its link."""

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
    """Make the tab."""
    shown = -1
    with ui.element("div").classes("grid-main"):
        with ui.element("div"):
            connect = ConnectCard(context)
            record = RecordCard(context)
            charts = ui.card().classes("w-full")
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
                    StripChart(session, connection.identity.channels)

    refresh()
    ui.timer(LOOK_S, refresh)
