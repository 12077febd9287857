"""Write `exit-codes.md` from the error classes: python docs/reference/write_exit_codes.py."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from benchtool.commands.app import UNEXPECTED_ERROR_CODE
from benchtool.core import errors

HEAD = """# Exit codes

Written by `python docs/reference/write_exit_codes.py` from `benchtool/core/errors.py` (tested).
Every error is one sentence on standard error, beginning with `benchtool: `.

| Code | Raised as | Meaning |
|---|---|---|
"""

OTHERS = (
    (0, "", "The command did what was asked."),
    (1, "`typer.Abort`", "A question was not answered; nothing was done."),
    (
        2,
        "`typer.TyperException`",
        "An unknown option, a missing argument or a wrong value.",
    ),
    (
        UNEXPECTED_ERROR_CODE,
        "",
        "A fault in benchtool itself; the sentence names a file with the traceback.",
    ),
    (130, "", "Ctrl-C, where no motors can turn."),
)
"""Codes that belong to no error class of ours: (code, class, meaning)."""


def family(kind: type[errors.BenchtoolError]) -> Iterator[type[errors.BenchtoolError]]:
    """Yield an error class and all classes below it, in the order of their definition."""
    yield kind
    for child in kind.__subclasses__():
        yield from family(child)


def page() -> str:
    """Return the text of `exit-codes.md`."""
    rows = list(OTHERS)
    for kind in family(errors.BenchtoolError):
        if kind.__module__ != errors.__name__:
            continue
        meaning = (kind.__doc__ or "").strip().splitlines()[0]
        rows.append((kind.exit_code, f"`{kind.__name__}`", meaning))
    rows.sort(key=lambda row: row[0])
    return HEAD + "".join(f"| {code} | {name} | {text} |\n" for code, name, text in rows)


if __name__ == "__main__":
    (Path(__file__).parent / "exit-codes.md").write_text(page(), "utf-8")
