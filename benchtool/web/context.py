"""Shared state of all pages, state of one page, and the control lock.

Message history and form values survive a page reload.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any

from benchtool.core.errors import BenchtoolError, InputError, RunInterrupted
from benchtool.data.run.runs_folder import RunsFolder
from benchtool.data.run.state import load_state, store_state
from benchtool.tasks import WorkerProcesses, to_user_error
from benchtool.web.bench_process.client import BenchClient
from benchtool.web.bench_process.messages import Command
from benchtool.web.bench_process.spawn import StopEndpoint

if TYPE_CHECKING:
    from benchtool.data.run.entry import Entry
    from benchtool.web.command_jobs import CommandJob

RECONNECT_TIMEOUT_S = 2.0  # a page disconnected for longer can lose the lock; assumed


class ControlLock:
    """Control lock: one page at a time may send commands; every page may stop.

    A page is identified by its browser tab's name, which survives a reload.
    """

    def __init__(self) -> None:
        self.holder: str | None = None
        self._connections: dict[str, int] = {}
        self._disconnected_s: float | None = None

    def connect(self, tab: str) -> None:
        """Add a connection of a page; the first page gets the lock."""
        self._connections[tab] = self._connections.get(tab, 0) + 1
        if self.holder is None:
            self.holder = tab
        if self.holder == tab:
            self._disconnected_s = None

    def disconnect(self, tab: str, now_s: float) -> None:
        """Remove a connection of a page, which keeps the lock until another page takes it."""
        n_connections = self._connections.get(tab, 0) - 1
        if n_connections > 0:
            self._connections[tab] = n_connections
            return
        self._connections.pop(tab, None)
        if self.holder == tab:
            self._disconnected_s = now_s

    def is_held_by(self, tab: str) -> bool:
        return tab != "" and self.holder == tab

    def is_free(self, now_s: float) -> bool:
        """Return whether a page may take the lock: no holder, or a disconnected one."""
        if self.holder is None:
            return True
        gone_s = self._disconnected_s
        return gone_s is not None and now_s - gone_s >= RECONNECT_TIMEOUT_S

    def acquire(self, tab: str, now_s: float) -> bool:
        """Acquire the lock if it is free; return whether this page holds it."""
        if not self.is_held_by(tab) and tab in self._connections and self.is_free(now_s):
            self.holder, self._disconnected_s = tab, None
        return self.is_held_by(tab)


HEARTBEAT_TIMEOUT_S = 1.0  # ten heartbeats of a page's worker; longest gap under load: 0.4 s
MAX_BLOCKED_S = 2.0  # for the main thread of a page


class PageWatch:
    """Monitor of page heartbeats; `find_problem` may be called from any thread."""

    def __init__(self) -> None:
        self._heartbeats: dict[str, tuple[float, float]] = {}

    def record_heartbeat(self, tab: str, blocked_s: float, now_s: float) -> None:
        """Store a heartbeat; `blocked_s` is the age of the main thread's last event loop turn."""
        self._heartbeats[tab] = (now_s, blocked_s)

    def disconnect(self, tab: str) -> None:
        self._heartbeats.pop(tab, None)

    def find_problem(self, tab: str | None, now_s: float) -> str:
        """Return why STOP cannot be pressed on a page, or "" if the page responds."""
        if tab is None:
            return ""
        heartbeat = self._heartbeats.get(tab)
        if heartbeat is None:
            return "the page with the control lock is closed or disconnected"
        silence_s, blocked_s = now_s - heartbeat[0], now_s - heartbeat[0] + heartbeat[1]
        if silence_s > HEARTBEAT_TIMEOUT_S:
            return f"no heartbeat from the page with the control lock for {HEARTBEAT_TIMEOUT_S:g} s"
        if blocked_s > MAX_BLOCKED_S:
            return f"the page with the control lock was blocked for {MAX_BLOCKED_S:g} s"
        return ""


MAX_MESSAGES = 200  # older messages are dropped; assumed
MAX_TABS = 20  # form values of tabs used longer ago are dropped; assumed
WRITE_DELAY_S = 0.5  # after a form change, to write several changes together; assumed


@dataclass(frozen=True, slots=True)
class LoggedMessage:
    """Logged message; `count` is the number of consecutive duplicates."""

    time: datetime
    text: str
    is_error: bool
    count: int = 1


class MessageHistory:
    """Message history with times; consecutive duplicates are stored once."""

    def __init__(self) -> None:
        self.messages: deque[LoggedMessage] = deque(maxlen=MAX_MESSAGES)

    def add(self, text: str, *, is_error: bool = False) -> None:
        count = 1
        if self.messages and self.messages[-1].text == text:
            count += self.messages.pop().count
        self.messages.append(LoggedMessage(datetime.now().astimezone(), text, is_error, count))


class FormState:
    """Form values of each browser tab, stored on disk per runs folder."""

    def __init__(self, runs: Path) -> None:
        self._name = str(runs.absolute())
        self._pending = False
        self._tabs: dict[str, dict[str, Any]] = {}
        with suppress(BenchtoolError):  # an unreadable file loses only form values
            self._tabs = load_state("page", self._name) or {}

    def values(self, tab: str) -> dict[str, Any]:
        """Return the form values of a browser tab by field name."""
        values = self._tabs.get(tab)
        return values if isinstance(values, dict) else {}

    def store(self, tab: str, field: str, value: Any) -> None:
        """Store a field's value and schedule the write."""
        values = self.values(tab)
        self._tabs.pop(tab, None)
        self._tabs[tab] = {**values, field: value}
        for old_tab in list(self._tabs)[:-MAX_TABS]:
            del self._tabs[old_tab]
        if not self._pending:
            self._pending = True
            asyncio.get_running_loop().call_later(WRITE_DELAY_S, self.write)

    def write(self) -> None:
        if self._pending:
            self._pending = False
            with suppress(BenchtoolError):
                store_state("page", self._name, self._tabs)


@dataclass(slots=True, kw_only=True)
class ServerState:
    """Shared state of all pages of a server."""

    runs: Path  # the only folder that pages read and write
    bench: BenchClient = field(default_factory=BenchClient)
    control: ControlLock = field(default_factory=ControlLock)
    watch: PageWatch = field(default_factory=PageWatch)
    stop_endpoint: StopEndpoint | None = None
    workers: dict[str, WorkerProcesses] = field(default_factory=dict)  # by purpose
    jobs: dict[str, CommandJob] = field(default_factory=dict)  # latest by kind
    log: MessageHistory = field(default_factory=MessageHistory)
    forms: FormState = field(init=False)

    def __post_init__(self) -> None:
        self.forms = FormState(self.runs)
        self.bench.page_problem = lambda: self.watch.find_problem(self.control.holder, monotonic())

    def close(self) -> None:
        """End the processes and delete incomplete job folders."""
        self.forms.write()
        for worker in self.workers.values():
            worker.shutdown()
        self.bench.close()  # stops the motors, so before jobs, which may take seconds
        for job in self.jobs.values():
            job.cancel()

    async def run(self, worker: str, function: Callable[..., Any], *arguments: Any) -> Any:
        """Return the result of a short function in the worker process of a purpose ("figures").

        Every error is raised as a `BenchtoolError`.
        """
        if worker not in self.workers:
            self.workers[worker] = WorkerProcesses(1)
        process = self.workers[worker]
        try:
            return await asyncio.wrap_future(process.submit(function, *arguments))
        except BrokenProcessPool:
            if self.workers.get(worker) is process:
                self.workers.pop(worker).shutdown()
            raise RunInterrupted(
                f"the process for {worker} ended unexpectedly; try again"
            ) from None
        except Exception as error:  # noqa: BLE001 -- the page shows every error
            raise to_user_error(error) from None

    def start_job(self, kind: str, create: Callable[[], CommandJob]) -> CommandJob:
        """Start a job, one per kind; delete the incomplete folder of the previous job."""
        if (previous := self.jobs.get(kind)) is not None:
            if not previous.done():
                raise InputError(
                    f"{previous.out.name} is still running ({previous.stage}); wait or cancel it"
                )
            previous.cancel()
        job = self.jobs[kind] = create()
        return job


@dataclass(slots=True, kw_only=True)
class PageContext:
    """State of one page in one browser tab."""

    server: ServerState
    tab: str = ""  # name of the browser tab, sent by the page on connection
    theme: str = ""  # "light", "dark", or "" to follow the system
    dark: bool = False  # sent by the page
    shows_connection: bool = False  # show the connection while a bench is open
    on_connect: Callable[[], object] = lambda: None  # called after the page has connected
    fields: dict[str, Any] = field(default_factory=dict)  # persistent form fields by name

    def connect(self, tab: str) -> None:
        """Set the name of the browser tab and restore its form values."""
        if tab != self.tab:
            self.tab = tab
            for name in self.fields:
                self._restore(name)
        self.on_connect()

    def persist(self, name: str, form_field: Any, *, restore: bool = True) -> None:
        """Restore the stored value of a field and store its changes.

        A select restores only values among its options. `restore` is False if the page's address
        sets the value.
        """
        self.fields[name] = form_field
        if restore:
            self._restore(name)
        else:
            self._store(name, form_field.value)
        form_field.on_value_change(lambda change: self._store(name, change.value))

    def _store(self, name: str, value: Any) -> None:
        if self.tab:
            self.server.forms.store(self.tab, name, value)

    def _restore(self, name: str) -> None:
        stored, form_field = self.server.forms.values(self.tab), self.fields[name]
        if name not in stored or form_field.is_deleted:
            return
        value, options = stored[name], getattr(form_field, "options", None)
        if options is not None and isinstance(value, list):
            value = [option for option in value if option in options]
        if options is None or isinstance(value, list) or value is None or value in options:
            form_field.set_value(value)

    @property
    def bench(self) -> BenchClient:
        return self.server.bench

    @property
    def runs(self) -> Path:
        return self.server.runs

    def in_control(self) -> bool:
        return self.server.control.is_held_by(self.tab)

    def require_control(self) -> None:
        """Raise unless this page has the control lock, before motors turn or runs are written."""
        if not self.in_control():
            is_free = self.server.control.is_free(monotonic())
            remedy = (
                "press Take over first" if is_free else "use that page, or close it and take over"
            )
            raise InputError(f"another page has the control lock; {remedy}")

    def claim_control(self) -> None:
        """Acquire the control lock if free, else raise; for handlers that only write files."""
        self.server.control.acquire(self.tab, monotonic())
        self.require_control()

    def send(self, command: Command) -> None:
        """Send a command to the bench process; raise without the control lock."""
        self.require_control()
        # A command proves that the page responds.
        self.server.watch.record_heartbeat(self.tab, 0.0, monotonic())
        self.bench.send(command)

    async def compute(self, worker: str, function: Callable[..., Any], *arguments: Any) -> Any:
        """Return the result of function(runs, *arguments) in a worker process."""
        return await self.server.run(worker, function, self.runs, *arguments)


class RunsListing:
    """Entries of a runs folder, read in a thread and only after a change."""

    def __init__(self, folder: RunsFolder) -> None:
        self.folder = folder
        self.entries: tuple[Entry, ...] = ()
        self._stamps: tuple[tuple[str, int], ...] | None = None

    async def refresh(self) -> bool:
        """Read the folder again if it has changed; return whether it has."""
        from benchtool.data.catalogue.index import load_entries

        try:
            stamps = await asyncio.to_thread(self._read_stamps)
            if stamps == self._stamps:
                return False
            self.entries = await asyncio.to_thread(load_entries, self.folder.root)
        except FileNotFoundError:  # an entry was moved meanwhile; the next refresh reads it
            return False
        self._stamps = stamps
        return True

    def _read_stamps(self) -> tuple[tuple[str, int], ...]:
        """Return modification times that change with a new entry or a closed run."""
        root = self.folder.root
        if not root.is_dir():
            return ()
        folders = [root, *(path for path in root.iterdir() if path.is_dir())]
        return tuple((path.name, path.stat().st_mtime_ns) for path in folders)
