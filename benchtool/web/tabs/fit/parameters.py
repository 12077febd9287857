"""The table of a model's numbers on the page: each free, or held at a value."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from nicegui import ui

from benchtool.report.numbers import unit_for_people
from benchtool.web.tabs.fit.model_choice import AdjustableParameter, ParameterChoice

HEADS = ("parameter", "unit", "free", "value", "bounds", "where the value comes from")


class ParameterTable:
    """Show a model's numbers; and what is chosen of each.

    Args:
        changed: called after every change.
    """

    def __init__(self, changed: Callable[[], None]) -> None:
        self._changed = changed
        self._numbers: tuple[AdjustableParameter, ...] = ()
        self._choices: dict[str, ParameterChoice] = {}
        self._place = ui.element("div").classes("w-full wide")

    @property
    def choices(self) -> dict[str, ParameterChoice]:
        """What is chosen of each number."""
        return dict(self._choices)

    def show(
        self, numbers: tuple[AdjustableParameter, ...], choices: Mapping[str, ParameterChoice]
    ) -> None:
        """Show a model's numbers, each as it is chosen, else as the model has it."""
        self._numbers = numbers
        self._choices = {
            number.name: choices.get(number.name, ParameterChoice(number.free, number.value))
            for number in numbers
        }
        self._place.clear()
        with self._place, ui.element("table").classes("shown parameters"):
            with ui.element("thead"), ui.element("tr"):
                for head in HEADS:
                    with ui.element("th").props("scope=col"):
                        ui.label(head)
            with ui.element("tbody"):
                for number in numbers:
                    self._row(number)

    def put_on_rig(self, numbers: tuple[AdjustableParameter, ...]) -> None:
        """Show the same model's numbers on another rig; what somebody changed stays."""
        if numbers == self._numbers:
            return
        shown = {
            number.name: ParameterChoice(number.free, number.value) for number in self._numbers
        }
        self.show(numbers, {k: choice for k, choice in self._choices.items() if choice != shown[k]})

    def _row(self, number: AdjustableParameter) -> None:
        choice = self._choices[number.name]
        with ui.element("tr"):
            with ui.element("th").props("scope=row"):
                ui.label(number.name)
            with ui.element("td"):
                ui.label(unit_for_people(number.unit))
            with ui.element("td"):
                free = ui.checkbox(value=choice.free).props("dense")
                free.props(f'aria-label="{number.name} is free"').mark(f"free {number.name}")
            with ui.element("td"):
                value = ui.number(value=choice.value, format="%.6g").props("dense outlined")
                value.props(f'aria-label="{number.name} is held at" step=any').classes("w-32")
                value.mark(f"value {number.name}")
                value.set_enabled(not choice.free)
            with ui.element("td").classes("number soft"):
                bounds = f"{number.lower:g} … {number.upper:g}"
                ui.label(bounds.replace("-", "−").replace("inf", "∞"))
            with ui.element("td").classes("soft"):
                ui.label(number.source)

        def take() -> None:
            held = number.value if value.value is None else float(value.value)
            # The number shows six digits: left as it is, it is the model's own.
            if f"{held:.6g}" == f"{number.value:.6g}":
                held = number.value
            value.set_enabled(not free.value)
            self._choices[number.name] = ParameterChoice(bool(free.value), held)
            self._changed()

        free.on_value_change(take)
        value.on_value_change(take)
