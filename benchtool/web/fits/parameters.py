"""The table of a model's numbers on the page: each free, or held at a value."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from nicegui import ui

from benchtool.report.numbers import unit_for_people
from benchtool.web.fits.choice import Adjustable, Wish

HEADS = ("parameter", "unit", "free", "value", "bounds", "where the value comes from")


class Parameters:
    """Show a model's numbers; what differs from the model is a wish.

    Args:
        changed: called after every change.
    """

    def __init__(self, changed: Callable[[], None]) -> None:
        self._changed = changed
        self._numbers: tuple[Adjustable, ...] = ()
        self._wishes: dict[str, Wish] = {}
        self._place = ui.element("div").classes("w-full wide")

    @property
    def wishes(self) -> dict[str, Wish]:
        """What the form asks of each number."""
        return dict(self._wishes)

    def show(self, numbers: tuple[Adjustable, ...], wishes: Mapping[str, Wish]) -> None:
        """Show a model's numbers, each as it is wished, else as the model has it."""
        self._numbers = numbers
        self._wishes = {
            number.name: wishes.get(number.name, Wish(number.free, number.value))
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

    def put_on_rig(self, numbers: tuple[Adjustable, ...]) -> None:
        """Show the same model's numbers on another rig; what somebody changed stays."""
        if numbers == self._numbers:
            return
        shown = {number.name: Wish(number.free, number.value) for number in self._numbers}
        self.show(numbers, {k: wish for k, wish in self._wishes.items() if wish != shown[k]})

    def _row(self, number: Adjustable) -> None:
        wish = self._wishes[number.name]
        with ui.element("tr"):
            with ui.element("th").props("scope=row"):
                ui.label(number.name)
            with ui.element("td"):
                ui.label(unit_for_people(number.unit))
            with ui.element("td"):
                free = ui.checkbox(value=wish.free).props("dense")
                free.props(f'aria-label="{number.name} is free"').mark(f"free {number.name}")
            with ui.element("td"):
                value = ui.number(value=wish.value, format="%.6g").props("dense outlined")
                value.props(f'aria-label="{number.name} is held at" step=any').classes("w-32")
                value.mark(f"value {number.name}")
                value.set_enabled(not wish.free)
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
            self._wishes[number.name] = Wish(bool(free.value), held)
            self._changed()

        free.on_value_change(take)
        value.on_value_change(take)
