"""Ask for what an option leaves open, where somebody is there to answer."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from benchtool.core.errors import InputError, UnknownChoice


def ask(
    question: str, option: str, *, usual: str = "", choices: Sequence[str] = (), reason: str = ""
) -> str:
    """Return what is typed on a terminal, again until it is one of the choices.

    Args:
        question: what is asked, without a question mark.
        option: that answers it, for whoever is not at a terminal.
        usual: what an empty line stands for.
        choices: known answers; any when empty.
        reason: why it is asked, for whoever is not at a terminal.

    Raises:
        InputError: nobody is at a terminal, or the input ended.
    """
    if not sys.stdin.isatty():
        raise InputError(f"{reason or question}; give {option}")
    offered = f" ({', '.join(choices)})" if choices else ""
    end = f" [{usual}]: " if usual else ": "
    while True:
        print(f"{question}?{offered}{end}", end="", flush=True)
        line = sys.stdin.readline()
        if not line:
            raise InputError(f"the input has ended; give {option}")
        typed = line.strip() or usual
        if typed and (not choices or typed in choices):
            return typed
        if typed:
            print(UnknownChoice("answer", typed, choices))
