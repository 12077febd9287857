"""Kill every command before every change of the disk, cut its power there, and print the table."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.kills.commands import KILLED
from tests.kills.states import check_all, tape
from tests.kills.test_kills import kill_by_strace

HEAD = "| command | changes of the disk | states after a kill or cut | distinct, checked | failed |"


STRACED = 40
"""Real processes that strace kills; each takes some seconds."""


def main() -> int:
    """Return 1 where something was lost, or a process could not be killed."""
    print(HEAD, "|---|---|---|---|---|", sep="\n")
    failed = []
    for killed in KILLED.values():
        with TemporaryDirectory() as folder:
            count = check_all(tape(killed, Path(folder)))
        print(count.row, flush=True)
        failed += count.failed
    print(*failed, sep="\n")
    if shutil.which("strace") is None:
        print("strace is not installed, so no real process was killed")
        return int(bool(failed))
    with TemporaryDirectory() as folder:
        killed = kill_by_strace(Path(folder), STRACED)
    print(f"{killed} of {STRACED} processes killed; every run that they left closes")
    return int(bool(failed) or killed < STRACED)


if __name__ == "__main__":
    sys.exit(main())
