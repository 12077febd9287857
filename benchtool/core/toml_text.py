"""Strict conversion of TOML text to frozen dataclasses; unknown keys are errors.

A number is plain, with the `source` of its table, or written as `{ value = 0.225, source = "...",
assumed = true }`. Types and ranges come from the dataclass annotations and are checked by pydantic.
"""

from __future__ import annotations

import dataclasses
import json
import types
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from math import isfinite
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    NoReturn,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

from benchtool.core.errors import FileFormatError, InputError, UnknownChoice

if TYPE_CHECKING:
    from pydantic import TypeAdapter

T = TypeVar("T")

MAX_DEPTH = 32  # nesting of tables and lists; files of benchtool have up to six levels
MAX_INTEGER = 2**63 - 1  # largest integer of TOML
_TOO_DEEP = f"it is nested deeper than {MAX_DEPTH} levels; write it with fewer"
_TOO_LARGE = f"a whole number in it is beyond {MAX_INTEGER} (64 bits); correct it"

_QUANTITY_KEYS = {"value", "source", "assumed"}
_UNKNOWN_KEY = {"extra_forbidden", "unexpected_keyword_argument"}  # pydantic's names for it


class FileTable:
    """Base class of dataclasses read from files; unknown keys are errors."""

    __slots__ = ()
    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}


class FiniteTable(FileTable):
    """Base class of dataclasses without nan and inf."""

    __slots__ = ()
    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid", "allow_inf_nan": False}


@dataclass(slots=True)
class ValueSources:
    """Sources of the numbers of a file, by dotted key."""

    by_key: dict[str, str] = field(default_factory=dict)
    assumed: list[str] = field(default_factory=list)


def parse_quantities(text: str, where: str) -> tuple[dict[str, Any], ValueSources]:
    """Return TOML tables with every `{value, source}` replaced by its value, and the sources.

    Raises:
        FileFormatError: invalid TOML, or a number without source.
    """
    sources, tables = ValueSources(), parse_toml(text, where)
    source = tables.pop("source", "")
    data = {key: _unwrap(value, key, source, sources) for key, value in tables.items()}
    if missing := [key for key, source in sources.by_key.items() if not source]:
        raise FileFormatError(
            where,
            f"{missing[0]} has no source; write it as {{ value = ..., source = '...' }} or "
            f"give its table a source (for a guess: source = 'assumed: ...')",
        )
    return data, sources


def _unwrap(value: Any, key: str, source: Any, sources: ValueSources) -> Any:
    assumed = None
    if isinstance(value, dict):
        source = value.get("source", source)
        if "value" not in value or not set(value) <= _QUANTITY_KEYS:
            return {
                name: _unwrap(item, f"{key}.{name}", source, sources)
                for name, item in value.items()
                if name != "source"
            }
        value, assumed = value["value"], value.get("assumed")
    elif isinstance(value, list):
        return [
            _unwrap(item, f"{key}[{index}]", source, sources) for index, item in enumerate(value)
        ]
    elif isinstance(value, bool) or not isinstance(value, int | float):
        return value
    sources.by_key[key] = source = source if isinstance(source, str) else ""
    if assumed if assumed is not None else source.lower().startswith("assumed"):
        sources.assumed.append(key)
    return value


def build_dataclass(cls: type[T], data: Mapping[str, Any], where: str) -> T:
    """Return `data` as an instance of the dataclass `cls`, with all keys and values checked.

    Raises:
        UnknownChoice: unknown key.
        FileFormatError: wrong type or range, or missing key.
    """
    from pydantic import ValidationError

    text = json.dumps(data, default=str)
    declared: Any = cls  # mypy does not know that classes are hashable
    try:
        built: T = _checker(declared).validate_json(text, strict=True)
        return built
    except InputError as error:  # from __post_init__
        raise FileFormatError(where, str(error)) from error
    except ValidationError as error:
        first = min(error.errors(), key=lambda item: item["type"] not in _UNKNOWN_KEY)
        location = tuple(first["loc"])
        dotted = _dotted(location)
        if first["type"] in _UNKNOWN_KEY:
            table = _dotted(location[:-1])
            location_text = f"[{table}] of {where}" if table else where
            raise UnknownChoice(
                f"key in {location_text}", str(location[-1]), _known_keys(cls, location[:-1])
            ) from error
        if first["type"] == "missing":
            raise FileFormatError(where, f"{dotted} is missing; add it") from error
        value = json.dumps(first["input"], default=str)
        reason = first["msg"].lower().replace("an object", "a table")
        problem = f"{dotted} is {value[:80]}: {reason}; correct the value"
        raise FileFormatError(where, problem) from error


@dataclass(eq=False)
class RefusedValue(ValueError):
    """Invalid value."""

    kind: str  # error type of pydantic
    value: Any
    reason: str  # expectation as text


def check_value(declared: Any, value: Any) -> Any:
    """Return a value converted to a declared type (lists become tuples).

    Raises:
        RefusedValue: wrong type, out of range, nan or inf.
    """
    from pydantic import ValidationError

    text = json.dumps(value, default=_plain)
    try:
        return _checker(declared).validate_json(text, strict=True)
    except ValidationError as error:
        first = error.errors()[0]
        raise RefusedValue(first["type"], first["input"], first["msg"].lower()) from None


def _plain(value: Any) -> Any:
    """Return a NumPy value or path in a form that JSON accepts."""
    return value.tolist() if hasattr(value, "tolist") else str(value)


@cache
def _checker(declared: Any) -> TypeAdapter[Any]:
    """Return the validator of a type, cached because pydantic needs about 10 ms to build it."""
    from pydantic import ConfigDict, TypeAdapter

    if dataclasses.is_dataclass(declared):  # has its own configuration
        return TypeAdapter(declared)
    return TypeAdapter(declared, config=ConfigDict(allow_inf_nan=False))


def read_strict(cls: type[T], text: str, where: str) -> T:
    """Return TOML text as an instance of `cls` (a `FileTable` dataclass)."""
    return build_dataclass(cls, parse_toml(text, where), where)


def _dotted(location: Sequence[int | str]) -> str:
    parts = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in location)
    return parts.removeprefix(".")


def _known_keys(cls: Any, location: Sequence[int | str]) -> list[str]:
    """Return the field names of the table that `location` leads to, starting from `cls`."""
    for part in location:
        cls = plain_type(cls, [])
        origin = get_origin(cls)
        if dataclasses.is_dataclass(cls):
            cls = get_type_hints(cls).get(str(part), object)
        elif origin is not None:
            arguments = [arg for arg in get_args(cls) if arg is not Ellipsis]
            cls = arguments[-1] if issubclass(origin, Mapping) else arguments[0]
    cls = plain_type(cls, [])
    if dataclasses.is_dataclass(cls):
        return [item.name for item in dataclasses.fields(cls)]
    return []


def plain_type(hint: Any, metadata: list[Any]) -> Any:
    """Return a type without None and without its annotations; append these to `metadata`."""
    if get_origin(hint) is Annotated:
        metadata.extend(hint.__metadata__)
        return plain_type(get_args(hint)[0], metadata)
    if get_origin(hint) in (Union, types.UnionType):
        return plain_type(next(arg for arg in get_args(hint) if arg is not type(None)), metadata)
    return hint


def parse_toml(text: str, where: str) -> dict[str, Any]:
    """Return the tables of TOML text; raise FileFormatError with the line of an error."""
    import tomllib

    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        problem = f"this is not valid TOML: {error}; correct that line"
        raise FileFormatError(where, problem) from error
    except RecursionError as error:
        raise FileFormatError(where, _TOO_DEEP) from error
    except ValueError as error:  # number with thousands of digits
        raise FileFormatError(where, _TOO_LARGE) from error
    _check_bounds(data, where)
    return data


def parse_json(text: str | bytes, where: str) -> Any:
    """Return the content of JSON text; raise FileFormatError for errors, nan and infinity."""

    def refuse(problem: object) -> NoReturn:
        raise FileFormatError(where, f"this is not valid JSON ({problem}); restore it from a copy")

    try:
        data = json.loads(text, parse_constant=lambda word: refuse(f"{word} is no number"))
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        refuse(error)
    except RecursionError as error:
        raise FileFormatError(where, _TOO_DEEP) from error
    except ValueError as error:
        raise FileFormatError(where, _TOO_LARGE) from error
    _check_bounds(data, where, finite=True)
    return data


def _check_bounds(data: Any, where: str, *, finite: bool = False) -> None:
    """Raise FileFormatError for deep nesting, and for invalid numbers and texts."""
    level, depth = [data], 0
    while level:
        depth += 1
        if depth > MAX_DEPTH + 1:
            raise FileFormatError(where, _TOO_DEEP)
        below: list[Any] = []
        for item in level:
            if isinstance(item, dict):
                below.extend(item.keys())
                below.extend(item.values())
            elif isinstance(item, list):
                below.extend(item)
            elif isinstance(item, str):
                if not item.isascii() and any("\ud800" <= letter <= "\udfff" for letter in item):
                    raise FileFormatError(
                        where, f"{item!r:.60} is not valid text; restore it from a copy"
                    )
            elif isinstance(item, int) and abs(item) > MAX_INTEGER:
                raise FileFormatError(where, _TOO_LARGE)
            elif finite and isinstance(item, float) and not isfinite(item):
                raise FileFormatError(where, "a number in it is beyond 1.8e308; correct it")
        level = below
