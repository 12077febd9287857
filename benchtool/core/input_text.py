"""Read the text that somebody typed for an input, and write a value as it would be typed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import Any

from benchtool.core.errors import InputError


def are_texts(value: Any) -> bool:
    """Return whether a value is a list of texts."""
    return isinstance(value, list | tuple) and all(isinstance(word, str) for word in value)


def read_texts(value: str | Sequence[Any], *, commas: bool) -> list[Any]:
    """Return the texts of one word or several; commas may part a word."""
    words = [value] if isinstance(value, str) else list(value)
    if not (commas and are_texts(words)):
        return words
    return [part.strip() for word in words for part in word.split(",") if part.strip()]


def read_number(text: str, called: str, kind: type[Any]) -> float:
    """Return the number of a text, whole where `kind` is int."""
    try:
        number: float = kind(text)
    except ValueError:
        wanted = "a whole number" if kind is int else "a number"
        raise InputError(f"{called} is {text!r}; type {wanted}") from None
    return number


def read_numbers(
    value: str | Sequence[str], called: str, kind: type[Any], count: int | None
) -> list[float]:
    """Return the numbers between commas, whole where `kind` is int.

    Args:
        value: the text, or several that mean the same as one with commas between them.
        called: the input, for a refusal.
        kind: int or float.
        count: how many there must be; None for one or more.
    """
    text = value if isinstance(value, str) else ",".join(value)
    wanted = "whole numbers" if kind is int else "numbers"
    try:
        found = [kind(part) for part in text.split(",") if part.strip()]
    except ValueError:
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


def text_of(value: Any) -> str:
    """Return a value as it would be typed; "" for none."""
    if isinstance(value, Mapping):
        return ", ".join(words_of(value, commas=False))
    if isinstance(value, list | tuple):
        return ",".join(map(text_of, value))
    if isinstance(value, float):
        return f"{value:g}" if float(f"{value:g}") == value else repr(value)
    return "" if value is None else str(value)


def words_of(value: Any, *, commas: bool) -> list[str]:
    """Return the words that give a value: several where it is a mapping, or a list of texts."""
    if isinstance(value, Mapping):
        return [f"{name}={text_of(number)}" for name, number in value.items()]
    if isinstance(value, list | tuple) and not commas:
        return [text_of(each) for each in value]
    return [text_of(value)]
