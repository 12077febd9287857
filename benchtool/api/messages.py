"""Messages of the command line in the words of Python calls."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

from benchtool.core.errors import InputError
from benchtool.report.result import temporary_folder

_OPTION = re.compile(  # with its value, unless the sentence goes on
    r"--([a-z][a-z-]*)(?: (?!(?:or|and|are|is|changes|sets|contains|with|to)\b)([^\s,;:)]+))?"
)


@contextmanager
def keyword_messages() -> Iterator[None]:
    """Write the message of an InputError with names of keywords; also a decorator."""
    try:
        yield
    except InputError as error:
        error.args = (keyword_names(str(error)),)
        raise


def keyword_names(text: str) -> str:
    """Return a message with names of keywords for options; commands stay as they are."""
    text = text.replace(f"{temporary_folder()}/", "")
    return (
        text if "benchtool " in text else _OPTION.sub(_keyword, text.replace("--map", "--columns"))
    )


def _keyword(option: re.Match[str]) -> str:
    name, value = option[1].replace("-", "_"), option[2]
    return name if value is None else f"{name}={value if value.isupper() else repr(value)}"
