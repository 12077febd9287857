"""Form fields made of declared inputs: text, choices or a box to tick, by the type of each."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from typing import Any, Generic, TypeVar

from nicegui import ui

from benchtool.core.input_text import format_value
from benchtool.core.inputs import InputField, Inputs, build_inputs, items, to_arguments
from benchtool.web.control_socket import PAGES

T = TypeVar("T", bound=Inputs)


class InputForm(Generic[T]):
    """Hold the fields of a dataclass of inputs and read what was typed.

    A page that is loaded anew finds them as they were.
    """

    def __init__(self, cls: type[T], changed: Callable[[], object]) -> None:
        self._cls, self._changed = cls, changed
        self._items = {item.name: item for item in items(cls)}
        self._fields: dict[str, Any] = {}

    def add(self, *names: str, options: Mapping[str, str] | None = None) -> None:
        """Make fields in the present slot; options are choices with longer labels."""
        for name in names:
            item = self._items[name]
            made = self._field(item, options)
            self._fields[name] = made.props("dense stack-label")
            if (context := PAGES.get(ui.context.client.id)) is not None:
                context.remember(f"{self._cls.__name__}.{name}", made)

    def _field(self, item: InputField, options: Mapping[str, str] | None) -> Any:
        if item.kind is bool:
            return ui.checkbox(item.label, value=bool(item.default), on_change=self._changed)
        empty = f"empty: {item.metadata.default_text or format_value(item.default) or '–'}"
        if options is not None:
            made: Any = ui.select(
                dict(options),
                multiple=item.is_sequence,
                value=None if item.is_sequence else item.default,
                label=item.label,
                on_change=self._changed,
            )
            if item.is_sequence or item.default is None:
                made.props("use-chips" if item.is_sequence else "clearable").props(
                    "hide-bottom-space"
                )
                made.props["hint"] = empty
            return made
        if item.choices:
            usual = {"": format_value(item.default)}
            rest = {each: each for each in item.choices if each != item.default}
            return ui.select(usual | rest, value="", label=item.label, on_change=self._changed)
        made = ui.input(item.label, placeholder=empty, on_change=self._changed)
        return made.props("debounce=300")

    def choose(self, name: str, options: Mapping[str, str], value: str) -> None:
        """Offer other choices in a field, and choose one."""
        self._fields[name].set_options(dict(options), value=value)

    def given(self) -> dict[str, Any]:
        """Return what was typed or chosen, by name; None where nothing was."""
        return {name: _given(field.value) for name, field in self._fields.items()}

    def make(self, base: T | None = None) -> T:
        """Return the inputs.

        Raises:
            InputError: something typed cannot be read, or is out of range.
        """
        return build_inputs(self._cls, self.given(), source="label", base=base)

    def words(self, more: Mapping[str, Any]) -> list[str]:
        """Return the words of the command line; `more` are inputs without a field."""
        return to_arguments(self._cls, {**self.given(), **more})

    def show_empty(self, texts: Mapping[str, str]) -> None:
        """Show in empty fields what runs instead, by name."""
        for name, text in texts.items():
            field, shown = self._fields.get(name), f"empty: {text}"
            if field is None:  # a remembered value can come before the fields below it are made
                continue
            if choices := self._items[name].choices:
                options = {"": text} | {each: each for each in choices if each != text}
                if field.options != options:
                    field.set_options(options, value=field.value if field.value in options else "")
            elif field.props["placeholder"] != shown:
                field.props["placeholder"] = shown
                field.update()

    def show_fields(self, names: Collection[str], shown: bool) -> None:
        """Show or hide fields; one with something typed in it stays."""
        for name in names:
            if (field := self._fields.get(name)) is not None:
                field.set_visibility(shown or _given(field.value) is not None)


def _given(value: Any) -> Any:
    value = value.strip() if isinstance(value, str) else value
    return None if value in ("", []) else value
