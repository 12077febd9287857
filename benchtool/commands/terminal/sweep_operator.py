"""The operator at a terminal."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING

from benchtool.commands.terminal.messages import say_error
from benchtool.core.errors import InputError

if TYPE_CHECKING:
    from benchtool.acquire.record import RunProgress

LOOK_S = 0.05


class TerminalOperator:
    """Print what is said; read answers from standard input."""

    def inform(self, text: str) -> None:
        print(text, flush=True)

    def warn(self, text: str) -> None:
        say_error(text)

    def answer(self, question: str, meanwhile: Callable[[], object] | None = None) -> str:
        print(question, end="", flush=True)
        if meanwhile is None:
            return _line(sys.stdin.readline())
        typed: list[str] = []
        reader = threading.Thread(target=lambda: typed.append(sys.stdin.readline()), daemon=True)
        reader.start()
        while reader.is_alive():
            meanwhile()
            reader.join(LOOK_S)
        return _line(typed[0] if typed else "")

    def display(self, radius_m: float | None) -> AbstractContextManager[RunProgress]:
        from benchtool.commands.terminal.sweep_display import display_for

        return display_for(radius_m)


TERMINAL = TerminalOperator()


def _line(line: str) -> str:
    if not line:
        print()
        raise InputError(
            "nobody answered: the input has ended; run it in a terminal, or give --yes where the "
            "bench allows it"
        )
    return line.rstrip("\n")
