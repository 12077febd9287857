"""Declare what a command takes: a frozen dataclass whose fields carry type, unit, range and help.

Everything that hands values in reads the declaration: the command line, a form of the page, the
command shown there, a plan file, and a call from Python. A range holds whichever of them a value
comes from, and the refusal names it as that source does: ``--ramp-s``, the label of the form,
``throttle.ramp_s`` in a file, ``ramp_s`` in a call. One input is one field::

    ramp_s: Annotated[float, Ge(0.0), Le(10.0), Input("Time from a level to the next.", "s")] = 0.3
"""

from __future__ import annotations

import types
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, MISSING, dataclass, fields, replace
from functools import cache
from typing import (
    Annotated,
    Any,
    ClassVar,
    Literal,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

from annotated_types import Ge, Gt, Le

from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.input_text import (
    format_arguments,
    is_string_sequence,
    read_number,
    read_numbers,
    read_pairs,
    read_texts,
)
from benchtool.core.toml_text import FiniteTable, RefusedValue, check_value

T = TypeVar("T")

Source = Literal["option", "keyword", "label"]  # command line, a call from Python, a form
MAX_NUMBER = 1e300  # beyond it a whole number cannot be written as others are

_OF_RANGE = (
    "greater_than", "greater_than_equal", "less_than", "less_than_equal", "finite_number",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Input:
    """Say what people read of an input, beyond its type, range and default.

    Attributes:
        option: name of option and keyword where it is not the field's.
        label: in a form; the help and the unit when left out.
        default_text: what runs where nothing is given, if the default does not say it.
        argument: what usage calls it where the command line takes it without an option.
        alias: a second spelling of the option.
        comma_separated: whether several texts may stand in one word, with commas between.
        instead_of: field beside it that it replaces.
        hidden: whether help and forms leave it out.
        group: heading of help under which it stands, and those of its part after it; the title of
            its dataclass when left out (`Inputs.TITLE`).
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


FILE_ONLY = Input("")  # of a field that only a file may give


class Inputs(FiniteTable):
    """Mark a dataclass of inputs: what it is made with is checked against the fields' types.

    Raises:
        InputError: a value of the wrong type or range, by the name of the field.
    """

    __slots__ = ()

    TITLE: ClassVar[str] = ""  # heading of help over the inputs of this dataclass

    def __post_init__(self) -> None:
        own: Any = type(self)
        for item in _fields_of(own):
            # Defaults are not checked here: that would import pydantic before anything is needed.
            value = getattr(self, item.key)
            if value is not item.default and value != {}:
                object.__setattr__(self, item.key, item.read(value, item.key))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class InputField:
    """Describe one input of a dataclass, the parts of parts included.

    Attributes:
        key: where it stands in a file, with dots between tables.
        declared: its type, without None.
        is_sequence, count: whether it holds several, and how many where that is fixed.
        choices: known values; empty for any.
        range: what numbers are taken, in words; "" for any.
        group: heading of help under which it stands; "" for the first, which has none of its own.
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
        """Whether it is a dataclass of inputs itself."""
        return isinstance(self.kind, type) and issubclass(self.kind, Inputs)

    @property
    def name(self) -> str:
        """Name as option (with hyphens) and as keyword."""
        return (self.metadata.option or self.key.rpartition(".")[2]).replace("-", "_")

    @property
    def required(self) -> bool:
        """Whether it must be given."""
        return self.default is MISSING

    @property
    def option(self) -> str:
        """Word of the command line that a value follows."""
        name = self.metadata.option or self.name
        return self.metadata.argument or f"--{name.replace('_', '-')}"

    @property
    def label(self) -> str:
        """Words beside its field in a form."""
        if self.metadata.label:
            return self.metadata.label
        unit = f", {self.metadata.unit}" if self.metadata.unit else ""
        return f"{self.metadata.help.rstrip('.')}{unit}"

    def display_name(self, source: Source) -> str:
        """Return what a source calls this input."""
        return {"option": self.option, "keyword": self.name, "label": self.label}[source]

    def read(self, value: Any, display_name: str) -> Any:
        """Return a value, or the text typed for it, as the declared type has it.

        Raises:
            InputError: it has the wrong type, or is out of range.
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
        elif isinstance(value, str) and self.kind in (int, float):
            value = read_number(value, display_name, self.kind, self.metadata.unit)
        try:
            return check_value(self.declared, value)
        except RefusedValue as refused:
            raise self._refusal(refused, display_name) from None

    def _refusal(self, refused: RefusedValue, called: str) -> InputError:
        value, unit = refused.value, f" {self.metadata.unit}" if self.metadata.unit else ""
        if self.choices and isinstance(value, str):
            return UnknownChoice(called, value, self.choices)
        if refused.kind == "too_short":
            return InputError(f"{called} names nothing; give one or more")
        if refused.kind not in _OF_RANGE:
            return InputError(f"{called} is {value!r:.80}: {refused.reason}; correct it")
        allowed = f"{self.range}{unit}" if self.range else "a finite number"
        point = (
            " (decimals take a point: 0.5, not 0,5)"
            if self.is_sequence and self.kind is float
            else ""
        )
        huge = isinstance(value, int) and abs(value) > MAX_NUMBER  # no float is that large
        given = f"beyond {MAX_NUMBER:g}" if huge else f"{value:g}"
        return InputError(
            f"{called} {'names' if self.is_sequence else 'is'} {given}{unit}, allowed is "
            f"{allowed}; correct it{point}"
        )


@cache
def _fields_of(cls: Any) -> tuple[InputField, ...]:
    """Return every field of one dataclass, described; parts are not entered."""
    hints = get_type_hints(cls, include_extras=True)
    return tuple(_item(one, hints[one.name]) for one in fields(cls))


def _item(field: Any, hint: Any) -> InputField:
    metadata: list[Any] = []

    def plain(hint: Any) -> Any:
        """Return a type without None and without what is noted on it, which is collected."""
        if get_origin(hint) is Annotated:
            metadata.extend(hint.__metadata__)
            return plain(get_args(hint)[0])
        if get_origin(hint) in (Union, types.UnionType):
            return plain(next(each for each in get_args(hint) if each is not type(None)))
        return hint

    kind = plain(hint)
    declared = Annotated[(kind, *metadata)] if metadata else kind
    about = next((each for each in metadata if isinstance(each, Input)), FILE_ONLY)
    many, count = get_origin(kind) is tuple, None
    if many:
        parts = get_args(kind)
        count = None if Ellipsis in parts else len(parts)
        kind = plain(parts[0])
    elif get_origin(kind) is Mapping:
        kind = Mapping
    choices = get_args(kind) if get_origin(kind) is Literal else ()
    factory = field.default_factory
    return InputField(
        key=field.name,
        declared=declared,
        kind=str if choices else kind,
        is_sequence=many,
        count=count,
        choices=choices,
        range=describe_range(metadata),
        default=field.default if factory is MISSING else factory(),
        metadata=about,
    )


def describe_range(metadata: Sequence[Any]) -> str:
    """Return what numbers are taken, in words."""
    low, above, high = (
        next((getattr(each, name) for each in metadata if isinstance(each, bound)), None)
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
    """Return every input of a dataclass, in order, those of its parts included.

    A field without an `Input` is no input: a file may say it, nothing else can.
    """
    return _items(cls)


@cache
def _items(cls: Any) -> tuple[InputField, ...]:
    return tuple(_walk(cls, ""))


def _walk(cls: Any, prefix: str, above: str = "") -> Iterator[InputField]:
    group = cls.TITLE or above
    for item in _fields_of(cls):
        if item.is_nested:
            yield from _walk(item.kind, f"{prefix}{item.key}.", group)
        elif item.metadata is not FILE_ONLY:
            group = item.metadata.group or group
            yield replace(item, key=f"{prefix}{item.key}", group=group)


def build_inputs(
    cls: type[T], given: Mapping[str, Any], *, source: Source = "keyword", base: T | None = None
) -> T:
    """Return the dataclass with what was given, by name, in place of what `base` or defaults say.

    Args:
        source: decides what a refusal calls an input.
        base: from a file; the defaults when left out.

    Raises:
        UnknownChoice: a name that no input has, or a value outside the known choices.
        InputError: a value of the wrong type or range, two that exclude each other, or none for
            an input that must be given.
    """
    known = {item.name: item for item in items(cls)}
    if unknown := [name for name in given if name not in known]:
        raise UnknownChoice("input", unknown[0], known)
    present = {known[name]: value for name, value in given.items() if value is not None}
    values: dict[str, Any] = {}
    for item, value in present.items():
        if other := item.metadata.instead_of:
            rival = next(one for one in known.values() if one.key == _beside(item.key, other))
            if rival in present:
                both = " and ".join(sorted((item.display_name(source), rival.display_name(source))))
                raise InputError(f"{both} are both given; give one of them")
            values[rival.key] = rival.default
        values[item.key] = item.read(value, item.display_name(source))
    for item in known.values():
        if base is None and item.default is MISSING and item.key not in values:
            raise InputError(f"{item.display_name(source)} is missing; give it")
    made: T = _assemble(cls, base, values, "")
    return made


def _beside(key: str, name: str) -> str:
    table, dot, _ = key.rpartition(".")
    return f"{table}{dot}{name}"


def _assemble(cls: Any, base: Any, values: Mapping[str, Any], prefix: str) -> Any:
    """Return a dataclass, or one of its parts, from values by key."""
    changes = {}
    for item in _fields_of(cls):
        key = f"{prefix}{item.key}"
        if key in values:
            changes[item.key] = values[key]
        elif item.is_nested and any(each.startswith(f"{key}.") for each in values):
            part = item.default if base is None else getattr(base, item.key)
            part = None if part is MISSING else part
            changes[item.key] = _assemble(item.kind, part, values, f"{key}.")
    return cls(**changes) if base is None else replace(base, **changes)


def input_values(inputs: Any) -> dict[str, Any]:
    """Return the value of every input of a dataclass, by name."""

    def value(key: str) -> Any:
        found = inputs
        for part in key.split("."):
            found = getattr(found, part)
        return found

    return {item.name: value(item.key) for item in items(type(inputs))}


def with_changes(inputs: Any) -> dict[str, Any]:
    """Return the inputs whose values are not the defaults, by name."""
    found = input_values(inputs)
    return {
        item.name: found[item.name]
        for item in items(type(inputs))
        if found[item.name] != item.default
    }


def to_arguments(cls: type[Any], given: Mapping[str, Any]) -> list[str]:
    """Return the words of the command line that give these values, arguments first.

    Args:
        cls: a dataclass of inputs.
        given: values, or the texts typed for them; what is None or empty is left out.
    """
    first: list[str] = []
    rest: list[str] = []
    for item in items(cls):
        value = given.get(item.name)
        if isinstance(value, bool):
            if value != item.default:
                rest.append(item.option if value else item.option.replace("--", "--no-", 1))
            continue
        if value is None or value in ("", (), [], {}):
            continue
        texts = format_arguments(
            value, commas=item.metadata.comma_separated or item.kind is not str
        )
        if item.metadata.argument:
            first += texts
        else:
            rest += [word for text in texts for word in (item.option, text)]
    return first + rest
