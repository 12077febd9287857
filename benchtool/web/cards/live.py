"""Live stream of a bench: readings in the header, charts drawn in the browser, quantities."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from nicegui import ui
from nicegui.element import Element

from benchtool.core.channel import CHANNELS, Channel
from benchtool.core.errors import InputError
from benchtool.core.rig import Limits
from benchtool.report.numbers import with_unit
from benchtool.web.bench_process import messages
from benchtool.web.context import PageContext
from benchtool.web.theme import STATIC, cycle
from benchtool.web.widgets import open_dialog, show_errors, show_facts, titled_card

STRIPS = {
    "thrust_N": ("Thrust", "N", 1.0, 3),
    "rpm#": ("Speed", "rpm", 1.0, 0),
    "pwm#_us": ("Pulse", "us", 1.0, 0),
    "torque_Nm": ("Torque", "N m", 1.0, 4),
    "plate_z_m": ("Plate distance", "mm", 1e3, 1),
    "plate_x_m": ("Plate lateral position", "mm", 1e3, 1),
    "plate_tilt_deg": ("Plate tilt", "deg", 1.0, 2),
    "theta_rad": ("Pitch", "deg", 57.29577951308232, 2),
    "voltage_V": ("Voltage", "V", 1.0, 2),
    "current_A": ("Current", "A", 1.0, 2),
    "temperature_degC": ("Temperature", "°C", 1.0, 1),
}
"""Charts shown by default, by channels: title, display unit, factor to it, decimals."""


def chart_panels(channels: Sequence[Channel], limits: Limits) -> list[dict[str, Any]]:
    """Return the chart panels of a bench's channels, the default ones first."""
    bounds, light, dark = messages.limits_by_family(limits), cycle(dark=False), cycle(dark=True)
    panels: dict[str, dict[str, Any]] = {pattern: {"lines": []} for pattern in STRIPS}
    for column, channel in enumerate(channels):
        pattern = re.sub(r"\d+", "#", channel.name)
        other = CHANNELS.get(pattern, pattern).capitalize(), channel.unit, 1.0, 3
        title, unit, factor, decimals = STRIPS.get(pattern, other)
        panel = panels.setdefault(pattern, {"lines": []})
        panel |= {"title": title, "unit": unit.replace("degC", "°C"), "decimals": decimals}
        panel |= {"factor": factor, "limit": bounds.get(pattern.replace("#", ""))}
        panel["selected"] = pattern in STRIPS
        index, label = len(panel["lines"]), "".join(re.findall(r"\d", channel.name))
        colors = {"light": light[index % len(light)], "dark": dark[index % len(dark)]}
        panel["lines"].append({"column": column, "name": channel.name, "label": label, **colors})
    return [panel for panel in panels.values() if panel["lines"]]


class StripChart(Element, component=STATIC / "strip_chart.js"):
    """Live charts of one session; tools are pause, window, panel selection, image and table."""

    def __init__(self, session: int, panels: list[dict[str, Any]], has_tools: bool) -> None:
        super().__init__()
        self._props.update(session=session, panels=panels, tools=has_tools, marks=[])
        self.classes("w-full")

    def show_marks(self, marks: Sequence[tuple[float, str]]) -> None:
        """Show annotations, each with stream time in s and text."""
        if len(marks) != len(self._props["marks"]):
            self._props["marks"] = [{"time_s": time_s, "text": text} for time_s, text in marks]
            self.update()


class AnnotationRow:
    """Field for annotations of the current run, if it is of one of these kinds."""

    def __init__(self, context: PageContext, *kinds: str) -> None:
        self._context, self._kinds = context, kinds
        with ui.row(wrap=False).classes("items-end w-full") as self._row:
            self._text = ui.input("Annotation for the run").classes("grow")
            self._text.props("dense").on("keydown.enter", self._annotate)
            ui.button("Annotate", icon="edit_note", on_click=self._annotate).props("outline")

    def refresh(self) -> None:
        sweep = self._context.bench.sweep
        self._row.set_visibility(sweep.active and sweep.kind in self._kinds)

    @show_errors
    def _annotate(self) -> None:
        if text := self._text.value.strip():
            self._context.send(messages.Annotate(text))
            self._text.value = ""


class ChartCard:
    """Charts of the connected bench, and annotations of its sweep or pitch recording.

    `only` are titles of charts without tools; default: all channels, with tools.
    """

    def __init__(self, context: PageContext, only: Sequence[str] = ()) -> None:
        self._context, self._only = context, only
        self._displayed: tuple[int, Limits] | None = None
        self._chart: StripChart | None = None
        with ui.card().classes("w-full") as self._card:
            self._container = ui.element("div").classes("w-full")
            self._annotation = AnnotationRow(context, "sweep", "pitch")

    def refresh(self) -> None:
        bench = self._context.bench
        identity, rig = bench.connection.identity, bench.connection.rig
        self._card.set_visibility(identity is not None or self._chart is not None)
        self._annotation.refresh()
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


WARNING_SHARE = 0.9  # share of a limit at which its bar changes colour; assumed


def reading_html(limit: messages.LimitShare) -> str:
    """Return a mean reading with its limit, and a bar that is full at the limit."""
    decimals = messages.DECIMALS.get(limit.unit, 0)
    value = round(limit.value, decimals) + 0.0  # not "-0"
    percent = 100.0 * min(max(limit.share, 0.0), 1.0)
    bound = f"{'min' if limit.is_minimum else 'max'} {limit.limit:g} {limit.unit}"
    css_class = "bar near" if limit.share >= WARNING_SHARE else "bar"
    return (
        f'<div><span class="soft">{limit.name}</span><span class="soft">{bound}</span>'
        f'<div class="value"><b>{value:.{decimals}f}</b> {limit.unit}</div>'
        f'<div class="{css_class}" role="meter" aria-valuenow="{percent:.0f}" '
        f'aria-label="{limit.name}, % of the limit"><div style="width: {percent:.1f}%"></div>'
        "</div></div>"
    )


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
            for name, family, unit in messages.LIMITED:
                key = "voltage_min_V" if family == "voltage_V" else family
                label = f"{('minimum ' * (key != family) + name).capitalize()}, {unit}"
                number = ui.number(label, value=getattr(rig.limits, key), format="%g")
                number.props(f'hint="rig: {getattr(rig_limits, key):g} {unit}" dense')
                inputs[key] = number.classes("w-full")

            @show_errors
            def send() -> None:
                numbers = {name: element.value for name, element in inputs.items()}
                for element in inputs.values():
                    if not element.value:
                        raise InputError(f"{element.label} is empty or 0; type a number above 0")
                self._context.send(messages.TightenLimits(replace(rig.limits, **numbers)))
                dialog.close()

            with ui.row():
                ui.button("Apply", on_click=send)
                ui.button("Cancel", on_click=dialog.close).props("outline")
