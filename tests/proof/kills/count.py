"""Kill every command before every change of the disk, cut its power there, and print the table."""

from __future__ import annotations

import json
import shutil
import sys
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.long_count import LongCount, sources_hash
from tests.proof.kills.commands import KILLED
from tests.proof.kills.states import Count, check_all, tape
from tests.proof.kills.test_kills import kill_by_strace

HEAD = "| command | changes of the disk | states after a kill or cut | distinct, checked | failed |"


STRACED = 40  # real processes that strace kills; each takes some seconds


def main() -> int:
    """Return 1 where something was lost, or a process could not be killed."""
    strace = shutil.which("strace") is not None
    path = Path(
        f"build/kills-{sources_hash('benchtool', 'tests/proof/kills', 'tests/faults')}.jsonl"
    )
    total = len(KILLED) + STRACED * strace
    print(HEAD, "|---|---|---|---|---|", sep="\n", flush=True)
    failed = []
    with LongCount(path, total, "commands and killed processes") as done:
        for number, killed in enumerate(KILLED.values()):
            if number == len(done.lines):
                with TemporaryDirectory() as folder:
                    done.add(json.dumps(asdict(check_all(tape(killed, Path(folder))))))
            count = Count(**json.loads(done.lines[number]))
            print(count.row, flush=True)
            failed += count.failed
        print(*failed, sep="\n")
        if strace and len(done.lines) < total:
            with TemporaryDirectory() as folder:
                skip = len(done.lines) - len(KILLED)
                kill_by_strace(Path(folder), STRACED, skip, lambda one: done.add(json.dumps(one)))
        ended = sum(map(json.loads, done.lines[len(KILLED) :]))
    if not strace:
        print("strace is not installed, so no real process was killed")
        return int(bool(failed))
    print(f"{ended} of {STRACED} processes killed; every run that they left closes")
    return int(bool(failed) or ended < STRACED)


if __name__ == "__main__":
    sys.exit(main())
