"""What a tab is given: the bench, the folder of runs, the controls, workers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from time import monotonic

from benchtool.errors import InputError
from benchtool.store.runs_folder import RunsFolder
from benchtool.web.bench_link import BenchLink
from benchtool.web.seat import Seat
from benchtool.web.worker import Worker


@dataclass(frozen=True, slots=True, kw_only=True)
class Shared:
    """Hold what every page of a server shares.

    Attributes:
        bench: the bench process.
        seat: which page is at the controls.
        runs: the only folder that pages read and write.
        workers: by what they work for; made with the first job.
    """

    runs: Path
    bench: BenchLink = field(default_factory=BenchLink)
    seat: Seat = field(default_factory=Seat)
    workers: dict[str, Worker] = field(default_factory=dict)

    def close(self) -> None:
        """End the processes."""
        for worker in self.workers.values():
            worker.close()
        self.bench.close()


@dataclass(slots=True, kw_only=True)
class Context:
    """Hold what belongs to one page in one browser tab.

    Attributes:
        shared: what all pages share.
        tab: name of the browser's tab, told by the page once it has connected.
        theme: "light", "dark", or empty to follow the system.
        dark: whether the page is dark now, told by the page.
        arrived: is called once the page has connected.
    """

    shared: Shared
    tab: str = ""
    theme: str = ""
    dark: bool = False
    arrived: Callable[[], object] = lambda: None

    @property
    def bench(self) -> BenchLink:
        """The bench process."""
        return self.shared.bench

    @property
    def runs(self) -> Path:
        """The folder of runs."""
        return self.shared.runs

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
        """Tell whether this page is at the controls."""
        return self.shared.seat.controls(self.tab)

    def need_control(self) -> None:
        """Refuse what turns motors or writes runs from a page that only watches.

        Raises:
            InputError: another page is at the controls.
        """
        if not self.in_control():
            free = self.shared.seat.is_free(monotonic())
            what = "press Take over first" if free else "ask there, or close it and take over"
            raise InputError(f"another page is at the controls, this one watches; {what}")

    def need_pen(self) -> None:
        """Refuse what writes, but turns no motor, from a page that only watches.

        Controls that nobody has any more are taken without a word.

        Raises:
            InputError: another page is at the controls.
        """
        self.shared.seat.take(self.tab, monotonic())
        self.need_control()

    def worker(self, name: str) -> Worker:
        """Return the process that works for something ("fits", "simulations")."""
        return self.shared.workers.setdefault(name, Worker(name))
