"""Input declarations: frozen dataclasses whose fields have type, unit, range and help.

The command line, the forms of the page, plan files and calls from Python use the same declaration.
An error names an input as its source does: ``--ramp-s``, the label of the form, ``throttle.ramp_s``
in a file, ``ramp_s`` in a call. One input is one field::

    ramp_s: Annotated[float, Ge(0.0), Le(10.0), Input("Time from a level to the next.", "s")] = 0.3
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, MISSING, dataclass, fields, replace
from functools import cache
from operator import attrgetter
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, TypeVar, get_args, get_origin, get_type_hints

from annotated_types import Ge, Gt, Le

from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.text import (
    format_arguments,
    is_string_sequence,
    read_number,
    read_numbers,
    read_pairs,
    read_texts,
)
from benchtool.core.toml_text import FiniteTable, RefusedValue, check_value, plain_type

T = TypeVar("T")

Source = Literal["option", "keyword", "label"]  # command line, a call from Python, a form
MAX_NUMBER = 1e300  # integers beyond it cannot be formatted as floats

_OF_RANGE = (
    "greater_than", "greater_than_equal", "less_than", "less_than_equal", "finite_number",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Input:
    """Display metadata of an input field.

    Attributes:
        option: name of option and keyword, if it differs from the field's.
        label: in a form; default: help and unit.
        default_text: text of the default, if the value does not explain it.
        argument: metavar of a positional argument.
        alias: a second spelling of the option.
        comma_separated: whether one argument may contain several texts, separated by commas.
        instead_of: field of the same dataclass that it replaces.
        hidden: whether help and forms omit it.
        group: heading in the help, also for the fields after it; default: `Inputs.TITLE`.
    """

    help: str
    unit: str = ""
    _: KW_ONLY
    option: str = ""
    label: str = ""
    default_text: str = ""
    argument: str = ""
    alias: str = ""
    comma_separated: bool = False
    instead_of: str = ""
    hidden: bool = False
    group: str = ""


FILE_ONLY = Input("")  # field that only a file can set


class Inputs(FiniteTable):
    """Base class of input dataclasses; values are checked against the field types.

    Raises:
        InputError: a value of the wrong type or range.
    """

    __slots__ = ()

    TITLE: ClassVar[str] = ""  # heading in the help

    def __post_init__(self) -> None:
        cls: Any = type(self)
        for item in _input_fields(cls):
            # Defaults are not checked: that would import pydantic early.
            value = getattr(self, item.key)
            if value is not item.default and value != {}:
                object.__setattr__(self, item.key, item.read(value, item.key))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class InputField:
    """Input field of a dataclass, including nested ones.

    Attributes:
        key: dotted key in a file.
        declared: its type, without None.
        is_sequence, count: whether it has several values, and their number if fixed.
        choices: known values; empty for any.
        range: text of the allowed range; "" for any.
    """

    key: str
    declared: Any
    kind: Any
    is_sequence: bool
    count: int | None
    choices: tuple[str, ...]
    range: str
    default: Any
    metadata: Input
    group: str = ""

    @property
    def is_nested(self) -> bool:
        """True for a nested dataclass of inputs."""
        return isinstance(self.kind, type) and issubclass(self.kind, Inputs)

    @property
    def name(self) -> str:
        """Name of option (with hyphens) and keyword."""
        return (self.metadata.option or self.key.rpartition(".")[2]).replace("-", "_")

    @property
    def required(self) -> bool:
        """True if there is no default."""
        return self.default is MISSING

    @property
    def option(self) -> str:
        """Option or metavar on the command line."""
        return self.metadata.argument or f"--{self.name.replace('_', '-')}"

    @property
    def label(self) -> str:
        """Label in a form."""
        if self.metadata.label:
            return self.metadata.label
        unit = f", {self.metadata.unit}" if self.metadata.unit else ""
        return f"{self.metadata.help.rstrip('.')}{unit}"

    def display_name(self, source: Source) -> str:
        """Return the name of this input for a source."""
        return {"option": self.option, "keyword": self.name, "label": self.label}[source]

    def read(self, value: Any, display_name: str) -> Any:
        """Return a value, or its text, converted to the declared type.

        Raises:
            InputError: wrong type or out of range.
        """
        if value is None and self.default is None:
            return None
        if self.is_nested:
            if isinstance(value, self.kind):
                return value
            raise InputError(
                f"{display_name} is {value!r:.60}; make it with {self.kind.__name__}(...)"
            )
        if self.kind is Mapping:
            value = value if isinstance(value, Mapping) else read_pairs(value, display_name)
        elif self.is_sequence and self.kind is str:
            value = read_texts(value, commas=self.metadata.comma_separated)
        elif self.is_sequence and (isinstance(value, str) or is_string_sequence(value)):
            value = read_numbers(value, display_name, self.kind, self.count, self.metadata.unit)
        elif self.is_sequence and isinstance(value, int | float):
            value = (value,)
        elif isinstance(value, Path) and self.kind is str:
            value = str(value)
        elif isinstance(value, str) and self.kind in (int, float):
            value = read_number(value, display_name, self.kind, self.metadata.unit)
        if self.kind in (str, bool, Path) and not self.choices:
            # Common texts need no check: pydantic takes 0.1 s to import.
            if not self.is_sequence and isinstance(value, self.kind):
                return value
            if self.is_sequence and value and all(isinstance(part, self.kind) for part in value):
                return tuple(value)
        try:
            return check_value(self.declared, value)
        except RefusedValue as refused:
            raise self._refusal(refused, display_name) from None

    def _refusal(self, refused: RefusedValue, name: str) -> InputError:
        value, unit = refused.value, f" {self.metadata.unit}" if self.metadata.unit else ""
        if self.choices and isinstance(value, str):
            return UnknownChoice(name, value, self.choices)
        if refused.kind == "too_short":
            return InputError(f"{name} is empty; give one or more")
        if refused.kind not in _OF_RANGE:
            return InputError(f"{name} is {value!r:.80}: {refused.reason}; correct it")
        allowed = f"{self.range}{unit}" if self.range else "a finite number"
        point = (
            " (decimals take a point: 0.5, not 0,5)"
            if self.is_sequence and self.kind is float
            else ""
        )
        is_huge = isinstance(value, int) and abs(value) > MAX_NUMBER  # beyond any float
        number = f"beyond {MAX_NUMBER:g}" if is_huge else f"{value:g}"
        return InputError(
            f"{name} {'names' if self.is_sequence else 'is'} {number}{unit}, allowed is "
            f"{allowed}; correct it{point}"
        )


@cache
def _input_fields(cls: Any) -> tuple[InputField, ...]:
    """Return the input fields of one dataclass, without those of nested ones."""
    hints = get_type_hints(cls, include_extras=True)
    return tuple(_item(field, hints[field.name]) for field in fields(cls))


def _item(field: Any, hint: Any) -> InputField:
    metadata: list[Any] = []
    kind = plain_type(hint, metadata)
    declared = Annotated[(kind, *metadata)] if metadata else kind
    input_metadata = next((entry for entry in metadata if isinstance(entry, Input)), FILE_ONLY)
    is_sequence, count = get_origin(kind) is tuple, None
    if is_sequence:
        parts = get_args(kind)
        count = None if Ellipsis in parts else len(parts)
        kind = plain_type(parts[0], metadata)
    elif get_origin(kind) is Mapping:
        kind = Mapping
    choices = get_args(kind) if get_origin(kind) is Literal else ()
    factory = field.default_factory
    return InputField(
        key=field.name,
        declared=declared,
        kind=str if choices else kind,
        is_sequence=is_sequence,
        count=count,
        choices=choices,
        range=describe_range(metadata),
        default=field.default if factory is MISSING else factory(),
        metadata=input_metadata,
    )


def describe_range(metadata: Sequence[Any]) -> str:
    """Return the allowed range as text."""
    low, above, high = (
        next((getattr(entry, name) for entry in metadata if isinstance(entry, bound)), None)
        for bound, name in ((Ge, "ge"), (Gt, "gt"), (Le, "le"))
    )
    lowest = "" if low is above is None else f"{low if above is None else above:,.10g}"
    highest = "" if high is None else f"{high:,.10g}"
    if above is not None:
        return f"above {lowest}" + (f", at most {highest}" if highest else "")
    if low is not None:
        return f"{lowest} to {highest}" if highest else f"{lowest} or more"
    return f"at most {highest}" if highest else ""


def items(cls: Any) -> tuple[InputField, ...]:
    """Return the inputs of a dataclass in order, including nested ones.

    A field without an `Input` can only be set in a file.
    """
    return _items(cls)


@cache
def _items(cls: Any) -> tuple[InputField, ...]:
    return tuple(_walk(cls, ""))


def _walk(cls: Any, prefix: str, parent_group: str = "") -> Iterator[InputField]:
    group = cls.TITLE or parent_group
    for item in _input_fields(cls):
        if item.is_nested:
            yield from _walk(item.kind, f"{prefix}{item.key}.", group)
        elif item.metadata is not FILE_ONLY:
            group = item.metadata.group or group
            yield replace(item, key=f"{prefix}{item.key}", group=group)


def build_inputs(
    cls: type[T],
    values_by_name: Mapping[str, Any],
    *,
    source: Source = "keyword",
    base: T | None = None,
) -> T:
    """Return the dataclass with the given values, by name; other values from `base` or defaults.

    Args:
        source: decides how an error names an input.

    Raises:
        UnknownChoice: an unknown name, or a value outside the known choices.
        InputError: a value of the wrong type or range, two exclusive inputs, or a missing one.
    """
    by_name = {item.name: item for item in items(cls)}
    if unknown := [name for name in values_by_name if name not in by_name]:
        raise UnknownChoice("input", unknown[0], by_name)
    present = {by_name[name]: value for name, value in values_by_name.items() if value is not None}
    values: dict[str, Any] = {}
    for item, value in present.items():
        if other := item.metadata.instead_of:
            key = ".".join([*item.key.split(".")[:-1], other])
            replaced = next(field for field in by_name.values() if field.key == key)
            if replaced in present:
                both = " and ".join(
                    sorted((item.display_name(source), replaced.display_name(source)))
                )
                raise InputError(f"{both} are both given; give one of them")
            values[replaced.key] = replaced.default
        values[item.key] = item.read(value, item.display_name(source))
    for item in by_name.values():
        if base is None and item.default is MISSING and item.key not in values:
            raise InputError(f"{item.display_name(source)} is missing; give it")
    inputs: T = _assemble(cls, base, values, "")
    return inputs


def _assemble(cls: Any, base: Any, values: Mapping[str, Any], prefix: str) -> Any:
    """Return a dataclass, or a nested one, from values by key."""
    changes = {}
    for item in _input_fields(cls):
        key = f"{prefix}{item.key}"
        if key in values:
            changes[item.key] = values[key]
        elif item.is_nested and any(name.startswith(f"{key}.") for name in values):
            part = item.default if base is None else getattr(base, item.key)
            part = None if part is MISSING else part
            changes[item.key] = _assemble(item.kind, part, values, f"{key}.")
    return cls(**changes) if base is None else replace(base, **changes)


def input_values(inputs: Any) -> dict[str, Any]:
    """Return the value of every input of a dataclass, by name."""
    return {item.name: attrgetter(item.key)(inputs) for item in items(type(inputs))}


def with_changes(inputs: Any) -> dict[str, Any]:
    """Return the inputs that differ from their defaults, by name."""
    values = input_values(inputs)
    defaults = {item.name: item.default for item in items(type(inputs))}
    return {name: value for name, value in values.items() if value != defaults[name]}


def to_arguments(cls: type[Any], values: Mapping[str, Any]) -> list[str]:
    """Return the command-line arguments of these values, positional ones first.

    The values may be texts; None and empty ones are omitted.
    """
    positional: list[str] = []
    options: list[str] = []
    for item in items(cls):
        value = values.get(item.name)
        if isinstance(value, bool):
            if value != item.default:
                options.append(item.option if value else item.option.replace("--", "--no-", 1))
            continue
        if value is None or value in ("", (), [], {}):
            continue
        texts = format_arguments(
            value, commas=item.metadata.comma_separated or item.kind is not str
        )
        if item.metadata.argument:
            positional += texts
        else:
            options += [word for text in texts for word in (item.option, text)]
    return positional + options
