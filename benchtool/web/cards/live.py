"""Cards with the live stream of a bench: charts, drawn in the browser, and limits."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any

from nicegui import ui
from nicegui.element import Element

from benchtool.core.channel import CHANNELS, Channel
from benchtool.core.errors import InputError
from benchtool.core.rig import Limits
from benchtool.web.bench_process.messages import Annotate, TightenLimits
from benchtool.web.context import PageContext
from benchtool.web.theme import STATIC, cycle
from benchtool.web.widgets import open_dialog, show_errors, titled_card

STRIPS = (
    ("Thrust", "thrust_N", "N", 1.0, 3),
    ("Speed", "rpm#", "rpm", 1.0, 0),
    ("Pulse", "pwm#_us", "us", 1.0, 0),
    ("Torque", "torque_Nm", "N m", 1.0, 4),
    ("Plate distance", "plate_z_m", "mm", 1e3, 1),
    ("Plate lateral position", "plate_x_m", "mm", 1e3, 1),
    ("Plate tilt", "plate_tilt_deg", "deg", 1.0, 2),
    ("Pitch", "theta_rad", "deg", 57.29577951308232, 2),
    ("Voltage", "voltage_V", "V", 1.0, 2),
    ("Current", "current_A", "A", 1.0, 2),
    ("Temperature", "temperature_degC", "°C", 1.0, 1),
)
"""Charts shown by default: title, channels, display unit, factor to it, decimals."""

DEFAULT_STRIPS = tuple(title for title, *_ in STRIPS)


def chart_panels(channels: Sequence[Channel]) -> list[dict[str, Any]]:
    """Return the chart panels of a bench's channels."""
    patterns = [re.sub(r"\d+", "#", channel.name) for channel in channels]
    defaults = {pattern: (title, unit, factor, n) for title, pattern, unit, factor, n in STRIPS}
    extra = {
        pattern: (CHANNELS.get(pattern, pattern).capitalize(), channel.unit, 1.0, 3)
        for pattern, channel in zip(patterns, channels, strict=True)
        if pattern not in defaults
    }
    panels = []
    for pattern, (title, unit, factor, decimals) in (defaults | extra).items():
        columns = [i for i, other in enumerate(patterns) if other == pattern]
        lines = [
            {
                "column": column,
                "name": channels[column].name,
                "label": "".join(re.findall(r"\d", channels[column].name)),
                "light": cycle(dark=False)[index % len(cycle(dark=False))],
                "dark": cycle(dark=True)[index % len(cycle(dark=True))],
            }
            for index, column in enumerate(columns)
        ]
        panel = {"title": title, "unit": unit, "factor": factor, "decimals": decimals}
        if lines:
            panels.append({**panel, "lines": lines})
    return panels


class StripChart(Element, component=STATIC / "strip_chart.js"):
    """Live charts of one session.

    Args:
        selected: titles of the panels shown at first.
        has_tools: show pause, time window, panel selection, image and table.
    """

    def __init__(
        self,
        session: int,
        channels: Sequence[Channel],
        selected: Sequence[str],
        *,
        has_tools: bool = True,
    ) -> None:
        super().__init__()
        panels = chart_panels(channels)
        titles = [panel["title"] for panel in panels]
        self._props["session"] = session
        self._props["panels"] = panels
        self._props["selected"] = [title for title in selected if title in titles]
        self._props["tools"] = has_tools
        self._props["marks"] = []
        self.classes("w-full")

    def show_marks(self, marks: Sequence[tuple[float, str]]) -> None:
        """Show annotations, each with stream time in s and text."""
        if len(marks) != len(self._props["marks"]):
            self._props["marks"] = [{"time_s": time_s, "text": text} for time_s, text in marks]
            self.update()


class ChartCard:
    """Charts of the connected bench, and a field for annotations of its run."""

    def __init__(
        self,
        context: PageContext,
        selected: Sequence[str] = DEFAULT_STRIPS,
        *,
        has_tools: bool = True,
    ) -> None:
        self._context, self._selected, self._has_tools = context, selected, has_tools
        self._session = -1
        self._chart: StripChart | None = None
        with ui.card().classes("w-full") as self._card:
            with ui.row(wrap=False).classes("items-end w-full") as self._annotation_row:
                self._text = ui.input("Annotation for the run").classes("grow")
                self._text.on("keydown.enter", self._annotate)
                ui.button("Annotate", icon="edit_note", on_click=self._annotate).props("outline")
            self._container = ui.element("div").classes("w-full")

    def refresh(self) -> None:
        bench = self._context.bench
        identity = bench.connection.identity
        self._card.set_visibility(identity is not None)
        self._annotation_row.set_visibility(bench.sweep.active)
        if bench.connection.session != self._session and identity is not None:
            self._session = bench.connection.session
            self._container.clear()
            with self._container:
                self._chart = StripChart(
                    self._session, identity.channels, self._selected, has_tools=self._has_tools
                )
        if self._chart is not None:
            self._chart.show_marks(bench.marks)

    @show_errors
    def _annotate(self) -> None:
        self._context.send(Annotate(self._text.value.strip()))
        self._text.value = ""


WARNING_SHARE = 0.9  # share of a limit at which its bar changes colour; assumed


class LimitsCard:
    """Readings as bars relative to their limits, and live quantities."""

    def __init__(self, context: PageContext) -> None:
        self._context = context
        self._bars: dict[str, tuple[ui.linear_progress, ui.label]] = {}
        with titled_card("Limits") as self._card:
            self._rows = ui.column().classes("w-full gap-1")
            ui.button("Tighten", icon="compress", on_click=self._tighten).props("outline")
            self._values = ui.element("div").classes("value-grid number")
            self._value_labels: dict[str, ui.label] = {}

    def refresh(self) -> None:
        limits = self._context.bench.live.limits
        self._card.set_visibility(bool(limits))
        if tuple(self._bars) != tuple(limit.name for limit in limits):
            self._rows.clear()
            self._bars.clear()
            with self._rows:
                for limit in limits:
                    with ui.element("div").classes("near-row"):
                        ui.label(limit.name)
                        bar = ui.linear_progress(show_value=False, size="10px")
                        bar.props(f'instant-feedback aria-label="{limit.name}, share of the limit"')
                        self._bars[limit.name] = bar, ui.label().classes("value number")
        for limit in limits:
            bar, label = self._bars[limit.name]
            bar.value = round(min(max(limit.share, 0.0), 1.0), 3)
            bar.props(f"color={'warning' if limit.share >= WARNING_SHARE else 'primary'}")
            label.set_text(f"{limit.value:.4g} of {limit.limit:g}")
        values = self._context.bench.live.values
        if tuple(self._value_labels) != tuple(value.name for value in values):
            self._values.clear()
            with self._values:
                pairs = [(ui.label(value.name), ui.label()) for value in values]
            self._value_labels = {
                value.name: pair[1] for value, pair in zip(values, pairs, strict=True)
            }
        for value in values:
            unit = "" if value.unit == "1" else f" {value.unit}"
            self._value_labels[value.name].set_text(f"{value.value:#.4g}{unit}")

    def _tighten(self) -> None:
        connection = self._context.bench.connection
        rig, rig_limits = connection.rig, connection.rig_limits
        if rig is None or rig_limits is None:
            return
        with open_dialog("Tighten limits") as dialog:
            ui.label("Valid until the bench is disconnected; at most the rig's limits.")
            inputs = {
                field.name: ui.number(
                    field.name,
                    value=getattr(rig.limits, field.name),
                    format="%g",
                )
                .props(f'hint="rig: {getattr(rig_limits, field.name):g}" dense')
                .classes("w-full")
                for field in fields(Limits)
                if field.name != "load_cell_rating_N"
            }

            @show_errors
            def send() -> None:
                numbers = {name: element.value for name, element in inputs.items()}
                missing = [name for name, number in numbers.items() if not number]
                if missing:
                    raise InputError(f"{missing[0]} is empty or 0; type a number above 0")
                self._context.send(TightenLimits(replace(rig.limits, **numbers)))
                dialog.close()

            with ui.row():
                ui.button("Apply", on_click=send)
                ui.button("Cancel", on_click=dialog.close).props("outline")
