"""Say which Python file of the user's own is about to run: the permit of the command line."""

from __future__ import annotations

import sys
from collections.abc import Iterable


def announce_code(file: str) -> None:
    """Permit a Python file that a person named, saying on stderr that it runs."""
    print(f"runs Python code of your own: {file}", file=sys.stderr, flush=True)


def print_notes(notes: Iterable[str]) -> None:
    """Print on stderr how a model file was read."""
    for note in notes:
        print(f"note: {note}", file=sys.stderr, flush=True)
