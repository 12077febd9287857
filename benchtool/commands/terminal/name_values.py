"""Options of the form NAME=VALUE."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite

from benchtool.core.errors import InputError


def name_values(words: Sequence[str], option: str) -> dict[str, float]:
    """Return names and numbers of `NAME=VALUE` words, or say which one is none."""
    out = {}
    for word in words:
        name, equals, text = word.partition("=")
        try:
            value = float(text)
        except ValueError:
            value = float("nan")
        if not equals or not name or not isfinite(value):
            raise InputError(f"{option} got {word!r}; write NAME=NUMBER, as K_b=1.8")
        out[name.strip()] = value
    return out
