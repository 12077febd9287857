"""How near every reading is to its limit."""

from __future__ import annotations

from nicegui import ui

from benchtool.web.context import Context

CLOSE = 0.9
"""Share of a limit from which on it is told apart; a choice."""


class LimitsCard:
    """Show a bar for each limit."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._bars: dict[str, tuple[ui.linear_progress, ui.label]] = {}
        with ui.card().classes("w-full") as self._card:
            ui.label("Limits").classes("card-title").props("role=heading aria-level=2")
            self._rows = ui.column().classes("w-full gap-1")
        self.refresh()

    def refresh(self) -> None:
        """Show what is so now."""
        near = self._context.bench.live.near
        self._card.set_visibility(bool(near))
        if tuple(self._bars) != tuple(one.name for one in near):
            self._rows.clear()
            self._bars.clear()
            with self._rows:
                for one in near:
                    with ui.element("div").classes("near-row"):
                        ui.label(one.name)
                        bar = ui.linear_progress(show_value=False, size="10px")
                        bar.props(f'instant-feedback aria-label="{one.name}, share of its limit"')
                        self._bars[one.name] = bar, ui.label().classes("value number")
        for one in near:
            bar, label = self._bars[one.name]
            bar.value = round(min(max(one.share, 0.0), 1.0), 3)
            bar.props(f"color={'warning' if one.share >= CLOSE else 'primary'}")
            label.set_text(f"{one.value:.4g} of {one.limit:g}")
