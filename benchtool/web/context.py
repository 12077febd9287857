"""What a tab is given: the bench, the folder of runs, the control lock, worker processes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from time import monotonic

from benchtool.core.errors import InputError
from benchtool.data.run.runs_folder import RunsFolder
from benchtool.web.bench_process.client import BenchClient
from benchtool.web.jobs import WorkerProcess

GRACE_S = 2.0
"""A controller that is gone for so long may be replaced: reloading a page takes less. A choice."""


class ControlLock:
    """Remember which page is at the controls; the others watch. The time is handed in.

    Pages are known by a name that a browser's tab keeps when it is loaded again. Stop needs no
    control: whoever sees the page may stop.
    """

    def __init__(self) -> None:
        self.holder: str | None = None
        self._here: dict[str, int] = {}
        self._gone_s: float | None = None

    def arrive(self, tab: str) -> None:
        """Note that a page is here; the first takes the controls."""
        self._here[tab] = self._here.get(tab, 0) + 1
        if self.holder is None:
            self.holder = tab
        if self.holder == tab:
            self._gone_s = None

    def leave(self, tab: str, now_s: float) -> None:
        """Note that a page is gone. It stays at the controls until another takes over."""
        left = self._here.get(tab, 0) - 1
        if left > 0:
            self._here[tab] = left
            return
        self._here.pop(tab, None)
        if self.holder == tab:
            self._gone_s = now_s

    def held_by(self, tab: str) -> bool:
        """Return whether this page is at the controls."""
        return tab != "" and self.holder == tab

    def is_free(self, now_s: float) -> bool:
        """Return whether another page may take over: nobody is at the controls, or they left."""
        if self.holder is None:
            return True
        return self._gone_s is not None and now_s - self._gone_s >= GRACE_S

    def take(self, tab: str, now_s: float) -> bool:
        """Take the controls when they are free; return whether this page has them now."""
        if not self.held_by(tab) and tab in self._here and self.is_free(now_s):
            self.holder, self._gone_s = tab, None
        return self.held_by(tab)


@dataclass(frozen=True, slots=True, kw_only=True)
class ServerState:
    """Hold what every page of a server shares.

    Attributes:
        runs: the only folder that pages read and write.
        workers: by what they work for; made with the first work.
    """

    runs: Path
    bench: BenchClient = field(default_factory=BenchClient)
    control: ControlLock = field(default_factory=ControlLock)
    workers: dict[str, WorkerProcess] = field(default_factory=dict)

    def close(self) -> None:
        """End the processes."""
        for worker in self.workers.values():
            worker.close()
        self.bench.close()


@dataclass(slots=True, kw_only=True)
class PageContext:
    """Hold what belongs to one page in one browser tab.

    Attributes:
        server: what all pages share.
        tab: name of the browser's tab, sent by the page once it has connected.
        theme: "light", "dark", or empty to follow the system.
        dark: whether the page is dark now, sent by the page.
        arrived: is called once the page has connected.
    """

    server: ServerState
    tab: str = ""
    theme: str = ""
    dark: bool = False
    arrived: Callable[[], object] = lambda: None

    @property
    def bench(self) -> BenchClient:
        """The bench process."""
        return self.server.bench

    @property
    def runs(self) -> Path:
        """The folder of runs."""
        return self.server.runs

    @property
    def runs_words(self) -> list[str]:
        """What names the folder of runs in a command; nothing where it is the usual one."""
        return [] if str(self.runs) == "runs" else ["--runs", str(self.runs)]

    def run_path(self, name: str) -> Path:
        """Return the path of something in the folder of runs.

        Raises:
            InputError: it leads out of that folder, or is not there.
        """
        return RunsFolder(self.runs).path_of(name)

    def in_control(self) -> bool:
        """Return whether this page is at the controls."""
        return self.server.control.held_by(self.tab)

    def require_control(self) -> None:
        """Refuse what turns motors or writes runs from a page that only watches.

        Raises:
            InputError: another page is at the controls.
        """
        if not self.in_control():
            free = self.server.control.is_free(monotonic())
            what = "press Take over first" if free else "ask there, or close it and take over"
            raise InputError(f"another page is at the controls, this one watches; {what}")

    def claim_control(self) -> None:
        """Refuse what writes, but turns no motor, from a page that only watches.

        Controls that nobody has any more are taken without a question.

        Raises:
            InputError: another page is at the controls.
        """
        self.server.control.take(self.tab, monotonic())
        self.require_control()

    def worker(self, name: str) -> WorkerProcess:
        """Return the process that works for something ("fits", "simulations")."""
        return self.server.workers.setdefault(name, WorkerProcess(name))
