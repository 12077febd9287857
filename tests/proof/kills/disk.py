"""A disk that forgets: what a command did to its folder, and what a kill or a power cut leaves.

`recorded` notes every change that a command makes below a folder, in order; nothing of the command
is replaced. `Disk` plays the changes back up to any of them. A process that is killed leaves what
it had handed to the system; reading calls change nothing, so one kill before each change stands
for a kill at every system call. A power cut leaves less: of a file's bytes what `fsync` forced
down, and any part of the rest up to one place (torn); of a folder's names those at its last
`fsync`, and of the changes since as many as were written down, in their order. Bytes and names are
independent, so that a renamed file may be empty. (POSIX.1-2017, fsync and its rationale; the same
model as in Pillai et al., All File Systems Are Not Created Equal, OSDI 2014.)
"""

from __future__ import annotations

import _pyio
import builtins
import io
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Any
from unittest import mock

Name = tuple[int, str]  # a folder's number and a name in it


@dataclass(frozen=True, slots=True)
class Change:
    """One change of the disk, by the numbers of files and folders.

    Attributes:
        kind: "link", "write", "cut", "sync".
        names: of a link, what each name leads to afterwards; 0 for nothing.
        number: of a file or folder that is written, cut, synced or made.
        said: characters that the command had printed before.
    """

    kind: str
    names: tuple[tuple[Name, int], ...] = ()
    number: int = 0
    is_folder: bool = False
    offset: int = 0
    data: bytes = b""
    said: int = 0


@dataclass
class Disk:
    """Files and folders by number; folder 1 is the root.

    Attributes:
        names, bytes_of: as programs see them.
        safe_names, safe_bytes: as they are after a power cut at the worst.
        waiting_names, waiting_bytes: changes since the last `fsync` of each folder and file.
    """

    names: dict[int, dict[str, int]] = field(default_factory=lambda: {1: {}})
    bytes_of: dict[int, bytearray] = field(default_factory=dict)
    safe_names: dict[int, dict[str, int]] = field(default_factory=lambda: {1: {}})
    safe_bytes: dict[int, bytes] = field(default_factory=dict)
    waiting_names: dict[int, list[dict[str, int]]] = field(default_factory=dict)
    waiting_bytes: dict[int, list[Change]] = field(default_factory=dict)

    @classmethod
    def of(cls, root: Path) -> Disk:
        """Return a disk that holds what a folder does, all of it safe."""
        disk, numbers = cls(), {str(root): 1}
        for place, folders, files in os.walk(root):
            for name in sorted([*folders, *files]):
                number = numbers[os.path.join(place, name)] = len(numbers) + 1
                disk.names[numbers[place]][name] = number
                if name in folders:
                    disk.names[number] = {}
                else:
                    disk.bytes_of[number] = bytearray(Path(place, name).read_bytes())
        disk.safe_names, disk.safe_bytes = deepcopy(disk.names), _frozen(disk.bytes_of)
        return disk

    def apply(self, change: Change) -> None:
        """Make one change."""
        number = change.number
        if change.kind == "link":
            if number and change.is_folder:
                self.names[number], self.safe_names[number] = {}, {}
            elif number:
                self.bytes_of[number], self.safe_bytes[number] = bytearray(), b""
            by_folder: dict[int, dict[str, int]] = {}
            for (folder, name), target in change.names:
                by_folder.setdefault(folder, {})[name] = target
            for folder, changed in by_folder.items():
                _rename(self.names[folder], changed)
                self.waiting_names.setdefault(folder, []).append(changed)
        elif change.kind == "sync" and number in self.names:
            self.safe_names[number] = dict(self.names[number])
            self.waiting_names[number] = []
        elif change.kind == "sync":
            self.safe_bytes[number] = bytes(self.bytes_of[number])
            self.waiting_bytes[number] = []
        else:
            _put(self.bytes_of[number], change)
            self.waiting_bytes.setdefault(number, []).append(change)

    def after_kill(self) -> dict[str, bytes | None]:
        """Return the files, and the folders as None, that a killed process leaves."""
        return _tree(self.names, _frozen(self.bytes_of))

    def after_power_cut(self, names: float, data: float, random: Random) -> dict[str, bytes | None]:
        """Return the files, and the folders as None, that a power cut leaves.

        Args:
            names, data: share of what waits that is on the disk; at random where it is negative.
        """

        def share(of: float) -> float:
            return random.random() if of < 0 else of

        folders = deepcopy(self.safe_names)
        for folder, waiting in self.waiting_names.items():
            for changed in waiting[: round(share(names) * len(waiting))]:
                _rename(folders[folder], changed)
        files = {number: bytearray(safe) for number, safe in self.safe_bytes.items()}
        for number, changes in self.waiting_bytes.items():
            left = round(share(data) * sum(len(change.data) or 1 for change in changes))
            for change in changes:
                if left > 0:
                    _put(files[number], change, left)
                left -= len(change.data) or 1
        return _tree(folders, _frozen(files))


def _frozen(files: dict[int, bytearray]) -> dict[int, bytes]:
    return {number: bytes(data) for number, data in files.items()}


def _rename(names: dict[str, int], changed: dict[str, int]) -> None:
    for name, target in changed.items():
        if target:
            names[name] = target
        else:
            names.pop(name, None)


def _put(file: bytearray, change: Change, most: int | None = None) -> None:
    if change.kind == "cut":
        del file[change.offset :]
        file.extend(bytes(change.offset - len(file)))
        return
    data = change.data[:most]
    file.extend(bytes(max(0, change.offset - len(file))))
    file[change.offset : change.offset + len(data)] = data


def _tree(names: dict[int, dict[str, int]], files: dict[int, bytes]) -> dict[str, bytes | None]:
    found: dict[str, bytes | None] = {}

    def walk(folder: int, place: str) -> None:
        for name, number in sorted(names[folder].items()):
            found[place + name] = files.get(number)
            if number in names:
                walk(number, f"{place}{name}/")

    walk(1, "")
    return found


def write_tree(root: Path, tree: dict[str, bytes | None]) -> None:
    """Make files and folders as `after_kill` and `after_power_cut` return them."""
    for name, data in tree.items():
        if data is None:
            (root / name).mkdir()
        else:
            (root / name).write_bytes(data)


def read_tree(root: Path) -> dict[str, bytes | None]:
    """Return what a folder holds, as `write_tree` takes it."""
    return Disk.of(root).after_kill()


@contextmanager
def recorded(root: Path, before: Callable[[int], None] | None = None) -> Iterator[list[Change]]:
    """Note every change of the disk that this process makes below a folder.

    Args:
        before: called with the number of each change before it is made.
    """
    tape = _Tape(root, before)
    with ExitStack() as stack:
        for name in ("open", "write", "fsync", "replace", "rename", "mkdir", "unlink", "remove",
                     "rmdir", "ftruncate"):  # fmt: skip
            stack.enter_context(mock.patch.object(os, name, tape.wrap(name)))
        for module in (builtins, io):
            stack.enter_context(mock.patch.object(module, "open", tape.open_file))
        yield tape.changes


class _Tape:
    """Make calls as they are, and note what each changes."""

    def __init__(self, root: Path, before: Callable[[int], None] | None) -> None:
        self.changes: list[Change] = []
        self._before = before or (lambda number: None)
        self._root = os.path.realpath(root)
        self._disk = Disk.of(Path(self._root))
        self._next = 1 + max([*self._disk.names, *self._disk.bytes_of])
        self._handles: dict[int, tuple[int, str]] = {}
        self._real = {name: getattr(os, name) for name in dir(os)}
        self._real_open = io.open

    def open_file(self, file: Any, mode: str = "r", *words: Any, **named: Any) -> Any:
        """Open for writing in Python throughout, so that every write is one of `os`."""
        writes = set(mode) & set("wxa+")
        return (_pyio.open if writes else self._real_open)(file, mode, *words, **named)

    def wrap(self, name: str) -> Callable[..., Any]:
        """Return a system call that is noted."""
        return lambda *words, **named: getattr(self, f"_{name}")(*words, **named)

    def _note(self, kind: str, **facts: Any) -> None:
        self._before(len(self.changes))
        getvalue = getattr(sys.stdout, "getvalue", None)
        said = len(getvalue()) if getvalue is not None else 0
        change = Change(kind, said=said, **facts)
        self.changes.append(change)
        self._disk.apply(change)

    def _place(self, path: Any, dir_fd: int | None = None) -> Name | None:
        """Return the folder's number and the name in it, None outside the root."""
        text = os.fspath(path)
        if dir_fd is not None:
            if dir_fd not in self._handles:
                return None
            text = os.path.join(self._handles[dir_fd][1], text)
        text = os.path.abspath(text)
        folder = os.path.join(os.path.realpath(os.path.dirname(text)), os.path.basename(text))
        if not folder.startswith(self._root + os.sep):
            return None
        *parts, name = folder[len(self._root) + 1 :].split(os.sep)
        number = 1
        for part in parts:
            number = self._disk.names[number].get(part, 0)
            if number not in self._disk.names:
                return None
        return number, name

    def _target(self, place: Name) -> int:
        return self._disk.names[place[0]].get(place[1], 0)

    def _open(self, path: Any, flags: int, mode: int = 0o777, *, dir_fd: int | None = None) -> int:
        place = self._place(path, dir_fd)
        if place is not None and flags & os.O_CREAT and not self._target(place):
            self._note("link", names=((place, self._next),), number=self._next)
            self._next += 1
        elif place is not None and flags & os.O_TRUNC and not flags & os.O_EXCL:
            self._note("cut", number=self._target(place))
        handle: int = self._real["open"](path, flags, mode, dir_fd=dir_fd)
        self._handles.pop(handle, None)
        full = os.path.join(self._handles[dir_fd][1] if dir_fd in self._handles else "", path)
        if place is not None:
            self._handles[handle] = self._target(place), os.path.abspath(full)
        elif os.path.realpath(full) == self._root:
            self._handles[handle] = 1, self._root
        return handle

    def _write(self, handle: int, data: Any) -> int:
        if handle in self._handles:
            number, view = self._handles[handle][0], bytes(data)
            at = os.lseek(handle, 0, os.SEEK_CUR)
            self._note("write", number=number, offset=at, data=view)
        return int(self._real["write"](handle, data))

    def _ftruncate(self, handle: int, size: int) -> None:
        if handle in self._handles:
            self._note("cut", number=self._handles[handle][0], offset=size)
        self._real["ftruncate"](handle, size)

    def _fsync(self, handle: int) -> None:
        if handle in self._handles:
            self._note("sync", number=self._handles[handle][0])
        self._real["fsync"](handle)

    def _rename(self, old: Any, new: Any, **named: Any) -> None:
        a, b = self._place(old), self._place(new)
        if a is not None and b is not None and self._target(a):
            self._note("link", names=((a, 0), (b, self._target(a))))
        self._real["rename"](old, new, **named)

    _replace = _rename

    def _mkdir(self, path: Any, mode: int = 0o777, *, dir_fd: int | None = None) -> None:
        place = self._place(path, dir_fd)
        if place is not None and not self._target(place):
            names = ((place, self._next),)
            self._note("link", names=names, number=self._next, is_folder=True)
            self._next += 1
        self._real["mkdir"](path, mode, dir_fd=dir_fd)

    def _unlink(self, path: Any, *, dir_fd: int | None = None) -> None:
        place = self._place(path, dir_fd)
        if place is not None and self._target(place):
            self._note("link", names=((place, 0),))
        self._real["unlink"](path, dir_fd=dir_fd)

    _remove = _unlink

    def _rmdir(self, path: Any, *, dir_fd: int | None = None) -> None:
        place = self._place(path, dir_fd)
        if place is not None and self._disk.names.get(self._target(place)) == {}:
            self._note("link", names=((place, 0),))
        self._real["rmdir"](path, dir_fd=dir_fd)
