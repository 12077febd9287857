"""Text of values and counts, for command line, forms and messages."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from math import isfinite
from typing import Any

from benchtool.core.errors import InputError

_WITH_UNIT = re.compile(
    r"\s*([-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?)\s*([^\s0-9.].*?)\s*"
)


def is_string_sequence(value: Any) -> bool:
    """Return True for a list or tuple of texts."""
    return isinstance(value, list | tuple) and all(isinstance(item, str) for item in value)


def read_texts(value: str | Sequence[Any], *, commas: bool) -> list[Any]:
    """Return the texts of one argument or several; commas may separate texts in one argument."""
    arguments = [value] if isinstance(value, str) else list(value)
    if not (commas and is_string_sequence(arguments)):
        return arguments
    return [part.strip() for word in arguments for part in word.split(",") if part.strip()]


def read_number(text: str, name: str, kind: type[Any], unit: str = "") -> float:
    """Return the number of a text, an integer if `kind` is int.

    Args:
        text: a number, with or without a unit: ``0.127``, ``127mm``, ``5 in``.
        name: of the input, for error messages.
        unit: of the result, and of a text without unit.

    Raises:
        InputError: not a number, or a unit of another dimension.
    """
    try:
        number: float = kind(text)
    except ValueError:
        expected, parts = "a whole number", None
        if kind is float:
            expected, parts = "a number", _WITH_UNIT.fullmatch(text)
        if parts and unit:
            return _convert(float(parts[1]), parts[2], unit, f"{name} is {text!r}")
        raise InputError(f"{name} is {text!r}; type {expected}") from None
    return number


def _convert(number: float, from_unit: str, unit: str, problem: str) -> float:
    """Return a number converted to another unit of its dimension."""
    from benchtool.core.units import UNITS, from_si, to_si  # imports numpy, not needed for help

    from_unit = "in" if from_unit in ("inch", "inches", '"') else from_unit
    target = UNITS.get(unit)
    same = [u.symbol for u in UNITS.values() if target and u.dimension == target.dimension]
    if from_unit in same:
        return from_si(to_si(number, from_unit), unit)
    raise InputError(f"{problem}; type a number, with a unit of {', '.join(same) or unit} or none")


def read_numbers(
    value: str | Sequence[str], name: str, kind: type[Any], count: int | None, unit: str = ""
) -> list[float]:
    """Return `count` comma-separated numbers, see `read_number`; count None means one or more."""
    text = value if isinstance(value, str) else ",".join(value)
    expected = "whole numbers" if kind is int else "numbers"
    try:
        parts = [part for part in text.split(",") if part.strip()]
        numbers = [read_number(part, name, kind, unit) for part in parts]
    except InputError:
        numbers = []
    if count not in (None, len(numbers)):
        raise InputError(f"{name} is {text!r}; give {count} numbers separated by commas")
    if not numbers and text.replace(",", "").strip():
        example = "1,2,3" if kind is int else "0.5,1,2 (decimals take a point)"
        raise InputError(
            f"{name} is {text!r}; give {expected} separated by commas, for example {example}"
        )
    if not numbers:
        raise InputError(f"{name} is empty; give numbers, for example 0.5,1,2")
    return numbers


def read_pairs(value: str | Sequence[str], input_name: str) -> dict[str, float]:
    """Return names and numbers of `NAME=NUMBER` arguments."""
    pairs = {}
    for word in [value] if isinstance(value, str) else value:
        name, _, number = word.partition("=")
        try:
            pairs[name.strip()] = float(number)
        except ValueError:
            name = ""
        if not name.strip() or not isfinite(pairs[name.strip()]):
            raise InputError(f"{input_name} got {word!r}; write NAME=NUMBER, as K_b=1.8")
    return pairs


def format_value(value: Any) -> str:
    """Return the command-line text of a value; "" for None."""
    if isinstance(value, Mapping):
        return ", ".join(format_arguments(value, commas=False))
    if isinstance(value, list | tuple):
        return ",".join(map(format_value, value))
    if isinstance(value, float):
        return f"{value:g}" if float(f"{value:g}") == value else repr(value)
    return "" if value is None else str(value)


def format_arguments(value: Any, *, commas: bool) -> list[str]:
    """Return the arguments of a value: several for a mapping or a list of texts."""
    if isinstance(value, Mapping):
        return [f"{name}={format_value(number)}" for name, number in value.items()]
    if isinstance(value, list | tuple) and not commas:
        return [format_value(item) for item in value]
    return [format_value(value)]


def pluralize(count: int, noun: str) -> str:
    """Return a count with its noun, which takes an s unless the count is 1: 1 row, 2,000 rows."""
    return f"{count:,} {noun}" if count == 1 else f"{count:,} {noun}s"
