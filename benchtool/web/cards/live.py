"""Live stream of a bench: readings in the header, charts drawn in the browser, quantities."""

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
from benchtool.report.numbers import with_unit
from benchtool.web.bench_process.messages import (
    Annotate,
    LimitShare,
    TightenLimits,
    limits_by_family,
)
from benchtool.web.context import PageContext
from benchtool.web.theme import STATIC, cycle
from benchtool.web.widgets import open_dialog, show_errors, show_facts, titled_card

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


def chart_panels(channels: Sequence[Channel], limits: Limits) -> list[dict[str, Any]]:
    """Return the chart panels of a bench's channels."""
    patterns = [re.sub(r"\d+", "#", channel.name) for channel in channels]
    defaults = {pattern: (title, unit, factor, n) for title, pattern, unit, factor, n in STRIPS}
    extra = {
        pattern: (CHANNELS.get(pattern, pattern).capitalize(), channel.unit, 1.0, 3)
        for pattern, channel in zip(patterns, channels, strict=True)
        if pattern not in defaults
    }
    bounds = limits_by_family(limits)
    light, dark = cycle(dark=False), cycle(dark=True)
    panels = []
    for pattern, (title, unit, factor, decimals) in (defaults | extra).items():
        columns = [i for i, other in enumerate(patterns) if other == pattern]
        lines = [
            {
                "column": column,
                "name": channels[column].name,
                "label": "".join(re.findall(r"\d", channels[column].name)),
                "light": light[index % len(light)],
                "dark": dark[index % len(dark)],
            }
            for index, column in enumerate(columns)
        ]
        panel = {"title": title, "unit": unit.replace("degC", "°C"), "decimals": decimals}
        panel |= {"factor": factor, "limit": bounds.get(pattern.replace("#", "")), "lines": lines}
        if lines:
            panels.append({**panel, "selected": pattern in defaults})
    return panels


class StripChart(Element, component=STATIC / "strip_chart.js"):
    """Live charts of one session.

    Args:
        has_tools: show pause, time window, panel selection, image and table.
    """

    def __init__(self, session: int, panels: list[dict[str, Any]], has_tools: bool) -> None:
        super().__init__()
        self._props.update(session=session, panels=panels, tools=has_tools, marks=[])
        self.classes("w-full")

    def show_marks(self, marks: Sequence[tuple[float, str]]) -> None:
        """Show annotations, each with stream time in s and text."""
        if len(marks) != len(self._props["marks"]):
            self._props["marks"] = [{"time_s": time_s, "text": text} for time_s, text in marks]
            self.update()


class ChartCard:
    """Charts of the connected bench, and a field for annotations of its run.

    Args:
        only: titles of the charts, without tools; default: all channels, with tools.
    """

    def __init__(self, context: PageContext, only: Sequence[str] = ()) -> None:
        self._context, self._only = context, only
        self._displayed: tuple[int, Limits] | None = None
        self._chart: StripChart | None = None
        with ui.card().classes("w-full") as self._card:
            self._container = ui.element("div").classes("w-full")
            with ui.row(wrap=False).classes("items-end w-full") as self._annotation_row:
                self._text = ui.input("Annotation for the run").classes("grow")
                self._text.props("dense").on("keydown.enter", self._annotate)
                ui.button("Annotate", icon="edit_note", on_click=self._annotate).props("outline")

    def refresh(self) -> None:
        bench = self._context.bench
        identity, rig = bench.connection.identity, bench.connection.rig
        self._card.set_visibility(identity is not None)
        self._annotation_row.set_visibility(bench.sweep.active)
        if identity is None or rig is None:
            return
        if (displayed := (bench.connection.session, rig.limits)) != self._displayed:
            self._displayed = displayed
            panels = chart_panels(identity.channels, rig.limits)
            if self._only:
                panels = [panel for panel in panels if panel["title"] in self._only]
            self._container.clear()
            with self._container:
                self._chart = StripChart(displayed[0], panels, has_tools=not self._only)
        if self._chart is not None:
            self._chart.show_marks(bench.marks)

    @show_errors
    def _annotate(self) -> None:
        if text := self._text.value.strip():
            self._context.send(Annotate(text))
            self._text.value = ""


WARNING_SHARE = 0.9  # share of a limit at which its bar changes colour; assumed
DECIMALS = {"N": 2, "V": 2, "A": 1, "°C": 1}  # of readings by unit


class Readings:
    """Strip of readings with their limits in the page's header."""

    def __init__(self, context: PageContext) -> None:
        self._context = context
        self._names: tuple[str, ...] = ()
        self._tiles: list[tuple[ui.label, ui.label, ui.linear_progress]] = []
        self._strip = ui.element("div").classes("readings")

    def refresh(self) -> None:
        limits = self._context.bench.live.limits
        self._strip.set_visibility(bool(limits))
        if self._names != (names := tuple(limit.name for limit in limits)):
            self._names = names
            self._strip.clear()
            with self._strip:
                self._tiles = [self._add_tile(limit) for limit in limits]
        for limit, (value, bound, bar) in zip(limits, self._tiles, strict=True):
            decimals = DECIMALS.get(limit.unit, 0)
            value.set_text(f"{round(limit.value, decimals) + 0.0:.{decimals}f}")  # not "-0"
            bound.set_text(f"{'min' if limit.is_minimum else 'max'} {limit.limit:g}")
            bar.value = round(min(max(limit.share, 0.0), 1.0), 3)
            bar.props(f"color={'warning' if limit.share >= WARNING_SHARE else 'primary'}")

    def _add_tile(self, limit: LimitShare) -> tuple[ui.label, ui.label, ui.linear_progress]:
        with ui.element("div"):
            ui.label(limit.name).classes("soft name")
            bound = ui.label().classes("soft")
            value = ui.label().classes("value")
            ui.label(limit.unit)
            bar = ui.linear_progress(show_value=False, size="4px")
            bar.props(f'instant-feedback aria-label="{limit.name}, share of the limit"')
        return value, bound, bar


class QuantitiesCard:
    """Mean thrust and derived quantities."""

    def __init__(self, context: PageContext) -> None:
        self._context = context
        with titled_card("Live quantities") as self._card:
            self._values = ui.element("div").classes("facts-grid number")
            ui.button("Tighten limits", icon="compress", on_click=self._tighten).props("outline")

    def refresh(self) -> None:
        live = self._context.bench.live
        self._card.set_visibility(bool(live.limits))
        facts = {name: with_unit(f"{x:#.4g}", unit) for name, (x, unit) in live.values.items()}
        show_facts(self._values, facts)

    def _tighten(self) -> None:
        connection = self._context.bench.connection
        rig, rig_limits = connection.rig, connection.rig_limits
        if rig is None or rig_limits is None:
            return
        with open_dialog("Tighten limits") as dialog:
            ui.label("Valid until the bench is disconnected; at most the rig's limits.")
            inputs = {}
            for name in (field.name for field in fields(Limits)):
                if name != "load_cell_rating_N":
                    number = ui.number(name, value=getattr(rig.limits, name), format="%g")
                    number.props(f'hint="rig: {getattr(rig_limits, name):g}" dense')
                    inputs[name] = number.classes("w-full")

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
