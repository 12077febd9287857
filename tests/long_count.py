"""Programs that count for long store results as they come; Ctrl-C ends them in one sentence."""

from __future__ import annotations

import hashlib
import signal
import sys
from pathlib import Path
from types import FrameType
from typing import Any, Self
from unittest import mock

ROOT = Path(__file__).parents[1]


class Stopped(BaseException):
    """Somebody wants the whole program to end; no KeyboardInterrupt, which a command answers."""


class LongCount:
    """Store one line for each item, print every tenth, and end at a signal from outside.

    Signals are this program's own until the end of the block: commands that run in this process do
    not see them, and what was in hand is not stored.

    Args:
        path: file of results, locked until the end of the block; its lines are those of before.
        total: of items; None where nobody knows.
        what: the items are called.
        resumes: whether the next call goes on with this file; else it begins empty.
        in_process: whether commands may run in this process; where not, benchtool is not imported.

    Attributes:
        earlier: so many of the lines are not of these items.
    """

    def __init__(
        self,
        path: Path,
        total: int | None,
        what: str,
        *,
        every: int = 10,
        resumes: bool = True,
        in_process: bool = True,
    ) -> None:
        self.path, self.total, self.what, self.every = path, total, what, every
        self.resumes, self.in_process = resumes, in_process
        self.lines: list[str] = []
        self.earlier = 0
        self._stopped = self._storing = False
        self._before: dict[int, Any] = {}
        self._quiet = mock.patch("benchtool.bench.stop_requests.SIGNAL_NAMES", ())

    def __enter__(self) -> Self:
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self._file = self.path.open("a+", encoding="utf-8")
        if sys.platform != "win32":
            import fcntl

            try:
                fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                self._file.close()
                raise SystemExit(
                    f"another process writes {self.path} now; wait until it has ended"
                ) from None
        self._file.seek(0)
        text = self._file.read() if self.resumes else ""
        text = text[: text.rfind("\n") + 1]  # a kill may have torn the last line
        self._file.truncate(len(text.encode()))
        self.lines = text.splitlines()
        if self.in_process:
            self._quiet.start()
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            number = getattr(signal, name, None)
            if number is not None and signal.getsignal(number) != signal.SIG_IGN:  # as by nohup
                self._before[number] = signal.signal(number, self._stop)
        return self

    def add(self, line: str) -> None:
        """Store one more item."""
        # Where something has swallowed the signal, too.
        if self._stopped:
            raise Stopped
        self._storing = True
        self._file.write(line + "\n")
        self._file.flush()
        self.lines.append(line)
        self._storing = False
        if self._stopped:
            raise Stopped
        number = len(self.lines) - self.earlier
        if number % self.every == 0 or number == self.total:
            print(f"{self.done} done", file=sys.stderr, flush=True)

    @property
    def done(self) -> str:
        """Say how many items are done."""
        number = len(self.lines) - self.earlier
        return f"{number}{'' if self.total is None else f' of {self.total}'} {self.what}"

    def _stop(self, number: int, frame: FrameType | None) -> None:
        self._stopped = True
        self._restore()  # the next one ends the program at once
        if not self._storing:
            raise Stopped

    def _restore(self) -> None:
        while self._before:
            signal.signal(*self._before.popitem())

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if self.in_process:
            self._quiet.stop()
        self._restore()
        self._file.close()
        if self._stopped and kind is not None:
            hint = "; the same command resumes" if self.resumes else ""
            here = Path.cwd()
            path = self.path.relative_to(here) if self.path.is_relative_to(here) else self.path
            print(f"stopped; {self.done} done, in {path}{hint}", file=sys.stderr, flush=True)
            raise SystemExit(130)


def sources_hash(*parts: str) -> str:
    """Return a hash of the Python and TOML files below these folders of the project."""
    digest = hashlib.sha256()
    for part in parts:
        for path in sorted((ROOT / part).rglob("*")):
            if path.suffix in (".py", ".toml"):
                digest.update(path.relative_to(ROOT).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()[:12]
