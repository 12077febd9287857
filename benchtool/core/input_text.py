"""Read the text that somebody typed for an input, and write a value as it would be typed."""

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
    """Return whether a value is a list of texts."""
    return isinstance(value, list | tuple) and all(isinstance(word, str) for word in value)


def read_texts(value: str | Sequence[Any], *, commas: bool) -> list[Any]:
    """Return the texts of one word or several; commas may part a word."""
    words = [value] if isinstance(value, str) else list(value)
    if not (commas and is_string_sequence(words)):
        return words
    return [part.strip() for word in words for part in word.split(",") if part.strip()]


def read_number(text: str, called: str, kind: type[Any], unit: str = "") -> float:
    """Return the number of a text, whole where `kind` is int.

    Args:
        text: a number, with or without a unit: ``0.127``, ``127mm``, ``5 in``.
        called: the input, for a refusal.
        kind: int or float.
        unit: of the number returned, and of a text without one.

    Raises:
        InputError: no number, or a unit of another dimension.
    """
    try:
        number: float = kind(text)
    except ValueError:
        wanted, parts = "a whole number", None
        if kind is float:
            wanted, parts = "a number", _WITH_UNIT.fullmatch(text)
        if parts and unit:
            return _converted(float(parts[1]), parts[2], unit, f"{called} is {text!r}")
        raise InputError(f"{called} is {text!r}; type {wanted}") from None
    return number


def _converted(number: float, given: str, unit: str, words: str) -> float:
    """Return a number in another unit of its dimension."""
    from benchtool.core.units import UNITS, from_si, to_si  # imports numpy, which help does without

    known = UNITS.get(unit)
    same = [one.symbol for one in UNITS.values() if known and one.dimension == known.dimension]
    if given in same:
        return from_si(to_si(number, given), unit)
    raise InputError(f"{words}; type a number, with a unit of {', '.join(same) or unit} or none")


def read_numbers(
    value: str | Sequence[str], called: str, kind: type[Any], count: int | None, unit: str = ""
) -> list[float]:
    """Return the numbers between commas, whole where `kind` is int.

    Args:
        value: the text, or several that mean the same as one with commas between them.
        called: the input, for a refusal.
        kind: int or float.
        count: how many there must be; None for one or more.
        unit: of the numbers returned, and of a text without one.
    """
    text = value if isinstance(value, str) else ",".join(value)
    wanted = "whole numbers" if kind is int else "numbers"
    try:
        parts = [part for part in text.split(",") if part.strip()]
        found = [read_number(part, called, kind, unit) for part in parts]
    except InputError:
        found = []
    if count not in (None, len(found)):
        raise InputError(f"{called} is {text!r}; give {count} numbers with commas between")
    if not found and text.replace(",", "").strip():
        example = "1,2,3" if kind is int else "0.5,1,2 (decimals take a point)"
        raise InputError(
            f"{called} is {text!r}, but {wanted} between commas are needed, like {example}"
        )
    if not found:
        raise InputError(f"{called} names no number; write it like 0.5,1,2")
    return found


def read_pairs(value: str | Sequence[str], called: str) -> dict[str, float]:
    """Return names and numbers of `NAME=NUMBER` words."""
    found = {}
    for word in [value] if isinstance(value, str) else value:
        name, _, number = word.partition("=")
        try:
            found[name.strip()] = float(number)
        except ValueError:
            name = ""
        if not name.strip() or not isfinite(found[name.strip()]):
            raise InputError(f"{called} got {word!r}; write NAME=NUMBER, as K_b=1.8")
    return found


def format_value(value: Any) -> str:
    """Return a value as it would be typed; "" for none."""
    if isinstance(value, Mapping):
        return ", ".join(format_arguments(value, commas=False))
    if isinstance(value, list | tuple):
        return ",".join(map(format_value, value))
    if isinstance(value, float):
        return f"{value:g}" if float(f"{value:g}") == value else repr(value)
    return "" if value is None else str(value)


def format_arguments(value: Any, *, commas: bool) -> list[str]:
    """Return the words that give a value: several where it is a mapping, or a list of texts."""
    if isinstance(value, Mapping):
        return [f"{name}={format_value(number)}" for name, number in value.items()]
    if isinstance(value, list | tuple) and not commas:
        return [format_value(each) for each in value]
    return [format_value(value)]
