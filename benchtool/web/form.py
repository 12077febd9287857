"""Form fields built from declared inputs: text field, select or checkbox by type."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, Generic, TypeVar

from nicegui import ui

from benchtool.core.errors import InputError, check_name
from benchtool.core.inputs import InputField, Inputs, build_inputs, items, to_arguments
from benchtool.core.text import format_value
from benchtool.web.sockets import PAGES

T = TypeVar("T", bound=Inputs)
Options = Mapping[str, str] | Sequence[str]

MAX_PLACEHOLDER_LENGTH = 22  # that the narrowest field displays; assumed


def run_name_error(text: str) -> str | None:
    """Return what is wrong with the name of a run; an empty one means the default."""
    try:
        check_name("run", text.strip() or "run", ascii_only=True)
    except InputError as error:
        return str(error)
    return None


class InputForm(Generic[T]):
    """Form of an inputs dataclass; its values survive a page reload."""

    def __init__(self, cls: type[T], on_change: Callable[[], object]) -> None:
        self._cls, self._on_change = cls, on_change
        self._items = {item.name: item for item in items(cls)}
        self._fields: dict[str, Any] = {}

    def add(self, *names: str, options: Options | None = None) -> None:
        """Create fields in the current slot; `options` are choices, possibly with labels."""
        for name in names:
            element = self._make_field(self._items[name], options)
            self._fields[name] = element.props("dense stack-label")
            if (context := PAGES.get(ui.context.client.id)) is not None:
                context.persist(f"{self._cls.__name__}.{name}", element)
            # After the restored value: it is no change, and later parts may not exist yet.
            element.on_value_change(self._on_change)

    def _make_field(self, item: InputField, options: Options | None) -> Any:
        if item.kind is bool:
            return ui.checkbox(item.label, value=bool(item.default))
        default = item.metadata.default_text or format_value(item.default)
        if options is not None:
            element: Any = ui.select(
                dict(options) if isinstance(options, Mapping) else list(options),
                multiple=item.is_sequence,
                value=None if item.is_sequence else item.default,
                label=item.label,
            )
            if item.is_sequence or item.default is None:
                element.props("use-chips" if item.is_sequence else "clearable")
                _show_default(element, default, "hint")
            return element.props("hide-bottom-space")
        if item.choices:
            labels = {"": format_value(item.default)}
            labels |= {choice: choice for choice in item.choices if choice != item.default}
            return ui.select(labels, value="", label=item.label)
        element = ui.input(item.label)
        _show_default(element, default)
        if item.name == "name":
            element.validation = run_name_error
        return element.props("debounce=300 hide-bottom-space")

    def choose(self, name: str, options: Mapping[str, str], value: str) -> None:
        """Replace the options of a field and select one."""
        self._fields[name].set_options(dict(options), value=value)

    def values(self) -> dict[str, Any]:
        """Return the field values by name; None for an empty field."""
        return {name: _parse_empty(field.value) for name, field in self._fields.items()}

    def make(self, base: T | None = None) -> T:
        """Return the inputs; raise for a value that is not readable or out of range."""
        check_name("run", self.values().get("name") or "run", ascii_only=True)
        return build_inputs(self._cls, self.values(), source="label", base=base)

    def arguments(self, extra: Mapping[str, Any]) -> list[str]:
        """Return the command-line arguments; `extra` are inputs without a field."""
        return to_arguments(self._cls, {**self.values(), **extra})

    def show_defaults(self, texts: Mapping[str, str]) -> None:
        """Set the default texts that empty fields display, by name."""
        for name, text in texts.items():
            field = self._fields.get(name)
            if field is None:  # not in this form
                continue
            if choices := self._items[name].choices:
                options = {"": text} | {choice: choice for choice in choices if choice != text}
                if field.options != options:
                    field.set_options(options, value=field.value if field.value in options else "")
            else:
                _show_default(field, text)

    def show_fields(self, names: Collection[str], is_visible: bool) -> None:
        """Show or hide fields; fields with a value stay visible."""
        for name in names:
            if (field := self._fields.get(name)) is not None:
                field.set_visibility(is_visible or _parse_empty(field.value) is not None)


def _show_default(field: Any, default: str, prop: str = "") -> None:
    """Display the default of an empty field: inside it, or below it if `prop` is "hint"."""
    text = f"empty: {default}" if default else ""
    prop = prop or ("placeholder" if len(text) <= MAX_PLACEHOLDER_LENGTH else "hint")
    if field.props.get(prop, "") != text:
        for name in ("placeholder", "hint"):
            field.props[name] = text if name == prop else None
        field.update()


def _parse_empty(value: Any) -> Any:
    value = value.strip() if isinstance(value, str) else value
    return None if value in ("", []) else value
