"""What the commands of closed-loop simulations say."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchtool.core.errors import InputError

if TYPE_CHECKING:
    from benchtool.report.result import Result


def say_if_slow() -> None:
    """Say that simulations are slow here, where they are."""
    from benchtool.physics.expression import can_compile

    if not can_compile():
        print(
            "numba is not installed, so this runs as plain Python and takes minutes; "
            "pip install benchtool[fast] makes it a second",
            file=sys.stderr,
        )


def show_study(result: Result[Any], out: Path | None) -> None:
    """Print what came out, and write it where a folder was named."""
    print(result.summary(), flush=True)
    if out is None:
        print("add --out FOLDER for the recordings (CSV) and the figure")
        return
    try:
        written = result.save(out)
    except OSError as error:
        raise InputError(
            f"{out} cannot be written: {error.strerror or error}; name another folder with --out"
        ) from error
    for path in written:
        print(f"written: {path}")
