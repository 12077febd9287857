"""Operator at a terminal."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING

from benchtool.commands.terminal.messages import print_error
from benchtool.core.errors import InputError

if TYPE_CHECKING:
    from benchtool.acquire.record import RunProgress

POLL_INTERVAL_S = 0.05


class TerminalOperator:
    """Print messages; read answers from standard input."""

    def inform(self, text: str) -> None:
        print(text, flush=True)

    def warn(self, text: str) -> None:
        print_error(text)

    def answer(self, question: str, meanwhile: Callable[[], object] | None = None) -> str:
        print(question, end="", flush=True)
        if meanwhile is None:
            return _check_line(sys.stdin.readline())
        lines: list[str] = []
        reader = threading.Thread(target=lambda: lines.append(sys.stdin.readline()), daemon=True)
        reader.start()
        while reader.is_alive():
            meanwhile()
            reader.join(POLL_INTERVAL_S)
        return _check_line(lines[0] if lines else "")

    def display(self, radius_m: float | None) -> AbstractContextManager[RunProgress]:
        from benchtool.commands.terminal.sweep_display import open_display

        return open_display(radius_m)


TERMINAL = TerminalOperator()


def _check_line(line: str) -> str:
    if not line:
        print()
        raise InputError(
            "no answer: end of input; run the command in a terminal, or use --yes (sweep, record) "
            "if the bench allows it"
        )
    return line.rstrip("\n")
