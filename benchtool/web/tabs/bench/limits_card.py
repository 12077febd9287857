"""Card with readings against limits, and measured and derived quantities."""

from __future__ import annotations

from dataclasses import fields, replace

from nicegui import ui

from benchtool.core.errors import InputError
from benchtool.core.rig import Limits
from benchtool.web.bench_process.messages import TightenLimits
from benchtool.web.context import PageContext
from benchtool.web.widgets import open_dialog, show_errors, titled_card

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
