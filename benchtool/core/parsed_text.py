"""TOML and JSON parsers with bounds on nesting depth and numbers."""

from __future__ import annotations

import json
from math import isfinite
from typing import Any

from benchtool.core.errors import FileFormatError

MAX_DEPTH = 32  # nesting of tables and lists; files of benchtool have up to six levels
MAX_INTEGER = 2**63 - 1  # largest integer of TOML


def parse_toml(text: str, where: str) -> dict[str, Any]:
    """Return the tables of TOML text; raise FileFormatError with the line of an error."""
    import tomllib

    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        problem = f"this is not valid TOML: {error}; correct that line"
        raise FileFormatError(where, problem) from error
    except RecursionError as error:
        raise _too_deep(where) from error
    except ValueError as error:  # number with thousands of digits
        raise _too_large(where) from error
    _check_bounds(data, where)
    return data


def parse_json(text: str | bytes, where: str) -> Any:
    """Return the content of JSON text; raise FileFormatError for errors, nan and infinity."""
    try:
        data = json.loads(text, parse_constant=_no_constant)
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        problem = f"this is not valid JSON ({error}); restore it from a copy"
        raise FileFormatError(where, problem) from error
    except _NoNumber as error:
        problem = f"this is not valid JSON ({error} is no number); restore it from a copy"
        raise FileFormatError(where, problem) from error
    except RecursionError as error:
        raise _too_deep(where) from error
    except ValueError as error:
        raise _too_large(where) from error
    _check_bounds(data, where, finite=True)
    return data


class _NoNumber(Exception):
    """JavaScript constant that is invalid in JSON, such as NaN."""


def _no_constant(word: str) -> None:
    raise _NoNumber(word)


def _check_bounds(data: Any, where: str, *, finite: bool = False) -> None:
    """Raise FileFormatError for deep nesting, and for invalid numbers and texts."""
    level, depth = [data], 0
    while level:
        depth += 1
        if depth > MAX_DEPTH + 1:
            raise _too_deep(where)
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
                raise _too_large(where)
            elif finite and isinstance(item, float) and not isfinite(item):
                raise FileFormatError(where, "a number in it is beyond 1.8e308; correct it")
        level = below


def _too_deep(where: str) -> FileFormatError:
    return FileFormatError(
        where, f"it is nested deeper than {MAX_DEPTH} levels; write it with fewer"
    )


def _too_large(where: str) -> FileFormatError:
    return FileFormatError(
        where, f"a whole number in it is beyond {MAX_INTEGER} (64 bits); correct it"
    )
