"""Who has a port open, as far as the operating system tells this user."""

from __future__ import annotations

import os
from dataclasses import dataclass

import psutil

_MASTERS = ("/dev/ptmx", "/dev/pts/ptmx")


@dataclass(frozen=True, slots=True)
class Holder:
    """Name one process that has a port open.

    Attributes:
        pid, name: of the process.
        is_terminal: whether it also holds the master end of pseudo-terminals, as a virtual bench.
    """

    pid: int
    name: str
    is_terminal: bool = False


def holders(port: str) -> tuple[Holder, ...]:
    """Return the processes that have `port` open; empty where the system does not say.

    Linux tells it in /proc for one's own processes. A process that also holds a pseudo-terminal's
    master is the terminal itself, not a user of it, and counts only when nobody else is found.
    """
    target = os.path.realpath(port)
    users: list[Holder] = []
    terminals: list[Holder] = []
    for process in psutil.process_iter(["pid", "name"]):
        paths = _open_paths(process.pid)
        if target in paths:
            is_terminal = bool(paths.intersection(_MASTERS))
            found = Holder(process.pid, process.info["name"] or "unnamed", is_terminal)
            (terminals if is_terminal else users).append(found)
    return tuple(users or terminals)


def holders_text(port: str) -> str:
    """Return the holders as words for a message."""
    found = holders(port)
    if not found:
        return "another program (the system does not say which)"
    return " and ".join(
        f"{holder.name} (pid {holder.pid}{', this program' if holder.pid == os.getpid() else ''})"
        for holder in found
    )


def _open_paths(pid: int) -> set[str]:
    folder = f"/proc/{pid}/fd"
    paths: set[str] = set()
    try:
        numbers = os.listdir(folder)
    except OSError:
        return paths
    for number in numbers:
        try:
            paths.add(os.readlink(f"{folder}/{number}"))
        except OSError:
            continue
    return paths
