"""Live charts of all channels of a bench, drawn in the browser from the stream."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from nicegui import ui
from nicegui.element import Element

from benchtool.core.channel import CHANNELS, Channel
from benchtool.web.bench_process.messages import Annotate
from benchtool.web.context import PageContext
from benchtool.web.theme import STATIC, cycle
from benchtool.web.widgets import show_errors

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
