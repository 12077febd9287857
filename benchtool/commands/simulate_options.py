"""Output of the closed-loop simulation commands."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchtool.core.errors import InputError

if TYPE_CHECKING:
    from benchtool.report.result import Result


def warn_if_slow() -> None:
    """Print a warning if simulations run without a compiler."""
    from benchtool.physics.expression import can_compile

    if not can_compile():
        print(
            "numba is not installed, so the simulation takes minutes instead of a second; use "
            "pip install benchtool[fast]",
            file=sys.stderr,
        )


def print_study(result: Result[Any], out: Path | None) -> None:
    """Print the summary of a result, and write it if a folder is given."""
    print(result.summary(), flush=True)
    if out is None:
        print("add --out FOLDER for the recordings (CSV) and the figure")
        return
    try:
        written = result.save(out)
    except OSError as error:
        raise InputError(
            f"{out} cannot be written: {error.strerror or error}; use another folder with --out"
        ) from error
    for path in written:
        print(f"written: {path}")
