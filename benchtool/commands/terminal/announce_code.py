"""Say which Python file of the user's own is about to run: the permit of the command line."""

from __future__ import annotations

import sys


def announce_code(file: str) -> None:
    """Permit a Python file that a person named, saying on stderr that it runs."""
    print(f"runs Python code of your own: {file}", file=sys.stderr, flush=True)
