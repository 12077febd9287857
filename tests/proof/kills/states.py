"""Every state of the disk that a kill or a power cut of a command can leave, and their check."""

from __future__ import annotations

import hashlib
import sys
import traceback
from collections.abc import Iterator
from contextlib import chdir
from copy import deepcopy
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from unittest import mock

from benchtool.core.errors import BenchtoolError
from tests.proof.kills.commands import Killed, Left, Tree
from tests.proof.kills.disk import Change, Disk, read_tree, recorded, write_tree

POWER_CUTS = {
    "nothing more": (0.0, 0.0),
    "names, no bytes": (1.0, 0.0),
    "bytes, no names": (0.0, 1.0),
    "torn": (1.0, -1.0),
    "some of all": (-1.0, -1.0),
}
"""What of the changes that no `fsync` forced down is on the disk: shares of names, of bytes."""

PROGRESS = 25  # a line is printed every so many changes


@dataclass(frozen=True, slots=True)
class Tape:
    """One command that ran to its end, and all that it changed."""

    killed: Killed
    before: Tree
    whole: Tree
    said: str
    changes: list[Change]


def tape(killed: Killed, root: Path) -> Tape:
    """Run a command to its end in an empty folder and note what it changes.

    The changes, played back, give the folder to the byte: nothing was written past them.
    """
    killed.prepare(root)
    before, disk = read_tree(root), Disk.of(root)
    with recorded(root) as changes:
        outcome = killed.run(root)
    for change in changes:
        disk.apply(change)
    whole = read_tree(root)
    assert disk.after_kill() == whole
    return Tape(killed, before, whole, outcome.said, changes)


@dataclass
class Count:
    """Count what was checked.

    Attributes:
        changes: before which a kill and power cuts were tried.
        states: what they left, alike or not.
        distinct: those that differ, each checked once.
    """

    name: str
    changes: int = 0
    states: int = 0
    distinct: int = 0
    failed: list[str] = field(default_factory=list)

    @property
    def row(self) -> str:
        """The line of a table."""
        cells = (self.name, self.changes, self.states, self.distinct, len(self.failed))
        return "| " + " | ".join(map(str, cells)) + " |"


def left_before(disk: Disk, change: Change | None, seed: int) -> Iterator[tuple[str, bool, Tree]]:
    """Yield what a kill and what power cuts before a change can leave, each with its name."""
    yield "kill", False, disk.after_kill()
    if change is not None and len(change.data) > 1:
        half = replace(change, data=change.data[: 1 + seed % (len(change.data) - 1)])
        torn = deepcopy(disk)
        torn.apply(half)
        yield "kill in the middle of a write", False, torn.after_kill()
    for name, (names, data) in POWER_CUTS.items():
        yield f"power cut, {name}", True, disk.after_power_cut(names, data, Random(seed))


def check_all(of: Tape, some: int | None = None, seed: int = 0) -> Count:
    """Check what a kill and power cuts before every change leave.

    Args:
        some: check so many of the changes, drawn at random, beside the end and those behind
            which something was said to be done; all where left out.
    """
    disk, seen, count = _disk(of.before), set(), Count(of.killed.name)
    ends = range(len(of.changes) + 1)
    chosen = set(ends if some is None else Random(seed).sample(ends, min(some, len(ends))))
    chosen |= {i for i, (a, b) in enumerate(pairwise(of.changes), 1) if a.said < b.said} | {
        ends[-1]
    }
    for number, change in enumerate([*of.changes, None]):
        if number % PROGRESS == 0 and number:
            print(f"{count.name}: {number} of {len(of.changes)} changes", file=sys.stderr)
        if number in chosen:
            count.changes += 1
            said = of.said[: len(of.said) if change is None else change.said]
            handed = disk.after_kill()
            for what, power, tree in left_before(disk, change, seed + number):
                count.states += 1
                key = hashlib.sha256(repr((power, said, tree, power and handed)).encode()).digest()
                if key in seen:
                    continue
                seen.add(key)
                count.distinct += 1
                if problem := _problem(of, tree, said, handed if power else tree, power):
                    where = "at its end" if change is None else f"before change {number}"
                    count.failed.append(f"{of.killed.name}, {what} {where}: {problem}")
        if change is not None:
            disk.apply(change)
    return count


def _problem(of: Tape, tree: Tree, said: str, handed: Tree, power: bool) -> str:
    """Return what does not hold of a state, "" where all holds."""
    # What is checked is read back at once, so nothing waits for a disk.
    with TemporaryDirectory() as folder, chdir(folder), mock.patch("os.fsync"):
        root = Path(folder)
        write_tree(root, tree)
        try:
            of.killed.check(Left(root, said, handed, of.whole, of.before, power))
        except (AssertionError, BenchtoolError, OSError) as error:
            line = traceback.extract_tb(error.__traceback__)[-1]
            return f"{type(error).__name__} {error} ({line.name}: {line.line})"
    return ""


def _disk(tree: Tree) -> Disk:
    with TemporaryDirectory() as folder:
        write_tree(Path(folder), tree)
        return Disk.of(Path(folder))
