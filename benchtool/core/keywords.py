"""Keywords of Python functions from input dataclasses: signature and docstring."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import MISSING
from pathlib import Path
from typing import Any, TypeVar

from benchtool.core.inputs import InputField, items

F = TypeVar("F", bound=Callable[..., Any])

_TYPES = {bool: "bool", int: "int", float: "float | str", str: "str", Path: "str | Path"}


def with_keywords(cls: type[Any], omit: Collection[str] = ()) -> Callable[[F], F]:
    """Return a decorator that names the inputs of a dataclass in place of `**options`.

    The inputs are added to the signature, and to the section Parameters of a numpydoc docstring,
    which the section Returns follows.

    `omit` are inputs of other parameters, and those that need the command line.
    """

    def decorated(function: F) -> F:
        own, target = inspect.signature(function), function.__dict__
        parameters = [item for item in own.parameters.values() if item.kind != item.VAR_KEYWORD]
        inputs = [item for item in items(cls) if item.name not in {*omit, *own.parameters}]
        target["__signature__"] = own.replace(parameters=[*parameters, *map(_parameter, inputs)])
        target["keyword_help"] = {item.name: keyword_help(item) for item in inputs}
        text, returns, end = inspect.cleandoc(function.__doc__ or "").partition("\n\nReturns\n")
        function.__doc__ = "\n".join([text, *map(_describe, inputs)]) + returns + end
        return function

    return decorated


def _parameter(item: InputField) -> inspect.Parameter:
    default = str(item.default) if isinstance(item.default, Path) else item.default
    return inspect.Parameter(
        item.name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=_annotation(item)
    )


def _annotation(item: InputField) -> str:
    """Return the types that a keyword accepts."""
    if item.kind is Mapping:
        return "Mapping[str, float] | Sequence[str]"
    text = f"Literal[{', '.join(map(repr, item.choices))}]" if item.choices else _TYPES[item.kind]
    text = f"{text} | Sequence[{text}]" if item.is_sequence else text
    return f"{text} | None" if item.default is None else text


def keyword_help(item: InputField) -> str:
    """Return the help of an input with its range, in the names of keywords."""
    text = re.sub(r"--([a-z][a-z-]*)", lambda match: match[1].replace("-", "_"), item.metadata.help)
    text = text.replace("; repeatable", "").replace(" Repeatable.", "")
    allowed = f"{item.range} {item.metadata.unit}".strip()
    return f"{text} [{allowed}]" if allowed else text


def _describe(item: InputField) -> str:
    """Return the entry of an input in a numpydoc section."""
    kind = re.sub(r"Literal\[(.*?)\]", r"{\1}", _annotation(item).removesuffix(" | None"))
    default = item.metadata.default_text or ("" if item.default is None else repr(item.default))
    assert item.default is not MISSING, item.name
    return f"{item.name} : {kind}, {f'default {default}' if default else 'optional'}\n    " + (
        keyword_help(item)
    )
