"""Sliders with their value written beside them."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from nicegui import ui

from benchtool.web.tabs.simulate.ranges import Slider
from benchtool.web.widgets import LocalSlider


class Sliders:
    """Show sliders, and know which numbers are changed.

    Args:
        changed: called when any of them moves.
    """

    def __init__(self, changed: Callable[[], None]) -> None:
        self._changed = changed
        self._place = ui.element("div").classes("simulate-numbers w-full")
        self._sliders: dict[str, tuple[Slider, LocalSlider]] = {}

    def offer(self, sliders: Iterable[Slider]) -> None:
        """Show these; one that was there before keeps its value where it was moved."""
        moved = self.moved
        self._place.clear()
        self._sliders = {}
        with self._place:
            for each in sliders:
                first = each.start if each.first is None else each.first
                value = moved.get(each.name, first)
                self._sliders[each.name] = (each, self._slider(each, value))

    def _slider(self, each: Slider, value: float) -> LocalSlider:
        with ui.element("div"):
            with ui.element("div").classes("simulate-number-head"):
                ui.label(each.label)
                said = ui.label(f"{value:.{each.decimals}f}").classes("number")
            slider = LocalSlider(min=each.low, max=each.high, step=each.step, value=value)
            slider.props(f'dense aria-label="{each.label}"').mark(each.name)

        def moved() -> None:
            said.set_text(f"{slider.value:.{each.decimals}f}")
            self._changed()

        slider.on_value_change(moved)
        return slider

    @property
    def moved(self) -> dict[str, float]:
        """Numbers that are not where they were at first, by name."""
        return {
            name: round(float(slider.value), each.decimals)
            for name, (each, slider) in self._sliders.items()
            if slider.value is not None and abs(slider.value - each.start) > 0.5 * each.step
        }

    def reset(self) -> None:
        """Put all where they were at first."""
        for each, slider in self._sliders.values():
            slider.set_value(each.start)
