"""Limits and how near every reading is to them; what is measured and what follows, as numbers."""

from __future__ import annotations

from dataclasses import fields, replace

from nicegui import ui

from benchtool.core.errors import InputError
from benchtool.core.rig import Limits
from benchtool.web.bench_process.messages import TightenLimits
from benchtool.web.context import PageContext
from benchtool.web.widgets import open_dialog, show_errors, titled_card

CLOSE = 0.9  # Share of a limit from which on its bar warns; a choice


class LimitsCard:
    """Show how near every reading is to its limit, a bar for each."""

    def __init__(self, context: PageContext) -> None:
        self._context = context
        self._bars: dict[str, tuple[ui.linear_progress, ui.label]] = {}
        with titled_card("Limits") as self._card:
            self._rows = ui.column().classes("w-full gap-1")
            ui.button("Tighten", icon="compress", on_click=self._tighten).props("outline")
            self._values = ui.element("div").classes("value-grid number")
            self._shown: dict[str, ui.label] = {}

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
        values = self._context.bench.live.values
        if tuple(self._shown) != tuple(one.name for one in values):
            self._values.clear()
            with self._values:
                pairs = [(ui.label(one.name), ui.label()) for one in values]
            self._shown = {one.name: pair[1] for one, pair in zip(values, pairs, strict=True)}
        for each in values:
            unit = "" if each.unit == "1" else f" {each.unit}"
            self._shown[each.name].set_text(f"{each.value:#.4g}{unit}")

    def _tighten(self) -> None:
        connection = self._context.bench.connection
        rig, stated = connection.rig, connection.stated
        if rig is None or stated is None:
            return
        with open_dialog("Tighten limits") as dialog:
            ui.label("They hold until the bench is disconnected; never wider than the rig's.")
            given = {
                field.name: ui.number(
                    field.name,
                    value=getattr(rig.limits, field.name),
                    format="%g",
                )
                .props(f'hint="rig: {getattr(stated, field.name):g}" dense')
                .classes("w-full")
                for field in fields(Limits)
                if field.name != "load_cell_rating_N"
            }

            @show_errors
            def send() -> None:
                numbers = {name: each.value for name, each in given.items()}
                missing = [name for name, number in numbers.items() if not number]
                if missing:
                    raise InputError(f"{missing[0]} has no number above 0; type each")
                limits = replace(rig.limits, **numbers)
                self._context.send(TightenLimits(limits))
                dialog.close()

            with ui.row():
                ui.button("Apply", on_click=send)
                ui.button("Cancel", on_click=dialog.close).props("outline")
