"""What a tab is given: the bench, the folder of runs, the control lock, processes that work."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from time import monotonic
from typing import Any, TypeVar

from benchtool.core.errors import InputError
from benchtool.data.catalogue.index import catalogued
from benchtool.data.run.entry import Entry
from benchtool.data.run.runs_folder import RunsFolder
from benchtool.web.bench_process.client import BenchClient
from benchtool.web.bench_process.messages import Command
from benchtool.web.bench_process.spawn import StopEndpoint
from benchtool.web.jobs import Job, WorkerProcess
from benchtool.web.page_memory import FormState, MessageHistory

J = TypeVar("J", bound=Job[Any])

RECONNECT_TIMEOUT_S = 2.0  # a controller gone for longer may be replaced; assumed


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
        return tab != "" and self.holder == tab

    def is_free(self, now_s: float) -> bool:
        """Return whether another page may take over: nobody is at the controls, or they left."""
        if self.holder is None:
            return True
        return self._gone_s is not None and now_s - self._gone_s >= RECONNECT_TIMEOUT_S

    def take(self, tab: str, now_s: float) -> bool:
        """Take the controls when they are free; return whether this page has them now."""
        if not self.held_by(tab) and tab in self._here and self.is_free(now_s):
            self.holder, self._gone_s = tab, None
        return self.held_by(tab)


MAX_BEAT_SILENCE_S = 1.0  # ten beats of a page's worker; the worst under load was 0.4 s
MAX_BLOCKED_S = 2.0  # longest time without a turn of a page's main thread


class PageWatch:
    """Latest beat of each page: when it came, and the age of its main thread's last turn.

    The time is handed in; `problem` may be called from any thread.
    """

    def __init__(self) -> None:
        self._beats: dict[str, tuple[float, float]] = {}

    def beat(self, tab: str, blocked_s: float, now_s: float) -> None:
        """Note a beat."""
        self._beats[tab] = (now_s, blocked_s)

    def leave(self, tab: str) -> None:
        """Note that a page's connection is closed."""
        self._beats.pop(tab, None)

    def problem(self, tab: str | None, now_s: float) -> str:
        """Return why nobody can press STOP on a page; empty if the page responds."""
        if tab is None:
            return ""
        beat = self._beats.get(tab)
        if beat is None:
            return "the page at the controls is closed, or its connection is lost"
        silent_s, blocked_s = now_s - beat[0], now_s - beat[0] + beat[1]
        if silent_s > MAX_BEAT_SILENCE_S:
            return f"no beat of the page at the controls for {MAX_BEAT_SILENCE_S:g} s"
        if blocked_s > MAX_BLOCKED_S:
            return f"the page at the controls was blocked for {MAX_BLOCKED_S:g} s"
        return ""


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
    watch: PageWatch = field(default_factory=PageWatch)
    stop_endpoint: StopEndpoint | None = None
    workers: dict[str, WorkerProcess] = field(default_factory=dict)
    jobs: dict[str, Job[Any]] = field(default_factory=dict)
    log: MessageHistory = field(default_factory=MessageHistory)
    forms: FormState = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "forms", FormState(self.runs))
        self.bench.page_problem = lambda: self.watch.problem(self.control.holder, monotonic())

    def close(self) -> None:
        """End the processes, and delete what jobs have not completed."""
        self.forms.write()
        for worker in self.workers.values():
            worker.close()
        self.bench.close()  # before jobs, which may take seconds: it stops the motors
        for job in self.jobs.values():
            job.cancel()

    def start_job(self, kind: str, begin: Callable[[], J]) -> J:
        """Start a job, one of a kind at a time; what the one before left incomplete is deleted.

        Raises:
            InputError: the one before still runs.
        """
        if (before := self.jobs.get(kind)) is not None:
            if before.state.running:
                raise InputError(
                    f"{before.out.name} still runs ({before.state.what}); wait, or cancel it"
                )
            before.cancel()
        job = self.jobs[kind] = begin()
        return job


@dataclass(slots=True, kw_only=True)
class PageContext:
    """Hold what belongs to one page in one browser tab.

    Attributes:
        tab: name of the browser's tab, sent by the page once it has connected.
        theme: "light", "dark", or empty to follow the system.
        dark: whether the page is dark now, sent by the page.
        arrived: is called once the page has connected.
        fields: of its forms that are remembered, by name.
    """

    server: ServerState
    tab: str = ""
    theme: str = ""
    dark: bool = False
    arrived: Callable[[], object] = lambda: None
    fields: dict[str, Any] = field(default_factory=dict)

    def arrive(self, tab: str) -> None:
        """Note the name of the browser's tab, and fill in what was typed in it before."""
        if tab != self.tab:
            self.tab = tab
            for name in self.fields:
                self._restore(name)
        self.arrived()

    def remember(self, name: str, form_field: Any, *, restore: bool = True) -> None:
        """Remember what is typed into a field, and fill in what was typed into it before.

        Args:
            name: of the field, the same after the page was loaded anew.
            form_field: an element with a value; of a select, only values that it offers.
            restore: leave out what was typed before where the page's address says something else.
        """
        self.fields[name] = form_field
        if restore:
            self._restore(name)
        else:
            self._note(name, form_field.value)
        form_field.on_value_change(lambda change: self._note(name, change.value))

    def _note(self, name: str, value: Any) -> None:
        if self.tab:
            self.server.forms.note(self.tab, name, value)

    def _restore(self, name: str) -> None:
        stored, form_field = self.server.forms.values(self.tab), self.fields[name]
        if name not in stored or form_field.is_deleted:
            return
        value, offered = stored[name], getattr(form_field, "options", None)
        if offered is not None and isinstance(value, list):
            value = [each for each in value if each in offered]
        if offered is None or isinstance(value, list) or value is None or value in offered:
            form_field.set_value(value)

    @property
    def bench(self) -> BenchClient:
        return self.server.bench

    @property
    def runs(self) -> Path:
        return self.server.runs

    def in_control(self) -> bool:
        return self.server.control.held_by(self.tab)

    def require_control(self) -> None:
        """Refuse what turns motors or writes runs from a page that only watches.

        Raises:
            InputError: another page is at the controls.
        """
        if not self.in_control():
            free = self.server.control.is_free(monotonic())
            what = "press Take over first" if free else "stop there, or close it and take over"
            raise InputError(f"another page is at the controls, this one watches; {what}")

    def claim_control(self) -> None:
        """Refuse what writes, but turns no motor, from a page that only watches.

        Controls that no page holds any more are taken without a question.

        Raises:
            InputError: another page is at the controls.
        """
        self.server.control.take(self.tab, monotonic())
        self.require_control()

    def send(self, command: Command) -> None:
        """Send a command to the bench process, from the page at the controls only.

        Raises:
            InputError: another page is at the controls.
        """
        self.require_control()
        self.server.watch.beat(self.tab, 0.0, monotonic())  # a page that sends responds
        self.bench.send(command)

    def worker(self, name: str) -> WorkerProcess:
        """Return the process that works for something ("fits", "simulations")."""
        return self.server.workers.setdefault(name, WorkerProcess(name))


class RunsListing:
    """Hold the entries of a runs folder, read beside the page's loop and only after a change."""

    def __init__(self, folder: RunsFolder) -> None:
        self.folder = folder
        self.entries: tuple[Entry, ...] = ()
        self._seen: tuple[tuple[str, int], ...] | None = None

    async def look(self) -> bool:
        """Read the folder anew where it has changed; return whether it has."""
        try:
            changed = await asyncio.to_thread(self._stamps)
            if changed == self._seen:
                return False
            self.entries = await asyncio.to_thread(catalogued, self.folder.root)
        except FileNotFoundError:  # something was moved meanwhile; the next look sees it
            return False
        self._seen = changed
        return True

    def _stamps(self) -> tuple[tuple[str, int], ...]:
        """Return what changes when something comes into the folder, or when a run is closed."""
        root = self.folder.root
        if not root.is_dir():
            return ()
        places = [root, *(item for item in root.iterdir() if item.is_dir())]
        return tuple((item.name, item.stat().st_mtime_ns) for item in places)
