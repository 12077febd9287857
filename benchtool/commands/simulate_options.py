"""What the commands of closed-loop simulations say."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from benchtool.core.errors import InputError


def say_if_slow(instead: str = "takes minutes", fast: str = "a second") -> None:
    """Say that simulations are slow here, where they are."""
    from benchtool.physics.expression import can_compile

    if not can_compile():
        print(
            f"numba is not installed, so this runs as plain Python and {instead}; "
            f"pip install benchtool[fast] makes it {fast}",
            file=sys.stderr,
        )


def refuse_twice(option: str, names: Sequence[str]) -> None:
    """Refuse a list in which a name stands twice."""
    if len(set(names)) < len(names):
        raise InputError(f"{option} is {', '.join(names)}; name each once")


def show_study(
    lines: Iterable[str], write: Callable[[Path], Iterable[Path]], out: Path | None
) -> None:
    """Print what came out, and write it where a folder was named."""
    for line in lines:
        print(line, flush=True)
    if out is None:
        print("add --out FOLDER for the recordings (CSV) and the figure")
        return
    try:
        written = list(write(out))
    except OSError as error:
        raise InputError(
            f"{out} cannot be written: {error.strerror or error}; name another folder with --out"
        ) from error
    for path in written:
        print(f"written: {path}")
