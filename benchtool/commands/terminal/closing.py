"""Close a run that an error has ended, without hiding that error."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

from benchtool.commands.terminal.exhausted_output import say_error
from benchtool.core.errors import BenchtoolError

if TYPE_CHECKING:
    from benchtool.data.run.run import Run


def close_stopped(run: Run, advice: str = "") -> None:
    """Write the tables of a run that stopped and say where it is; what prevents it is said only.

    Args:
        run: an error that ended it is on its way.
        advice: how to go on.
    """
    try:
        run.close()
    except (BenchtoolError, OSError, MemoryError) as error:
        say_error(f"{run.path} was not closed: {error}")
        return
    with suppress(OSError):
        print("; ".join(filter(None, (f"what was recorded is in {run.path}", advice))))
