"""Close a run that an error has ended, without hiding that error."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from benchtool.errors import BenchtoolError

if TYPE_CHECKING:
    from benchtool.store import Run


def close_stopped(run: Run, advice: str = "") -> None:
    """Write the tables of a run that stopped and say where it is; what prevents it is said only.

    Args:
        run: an error that ended it is on its way.
        advice: how to go on.
    """
    try:
        run.close()
    except (BenchtoolError, OSError, MemoryError) as error:
        print(f"benchtool: {run.path} could not be closed: {error}", file=sys.stderr)
        return
    print("; ".join(filter(None, (f"what was recorded is in {run.path}", advice))))
