"""Long work in a process of its own: how far it is, cancel, then its result or one sentence.

The page's event loop only looks. A job belongs to the server and not to a browser: a page that is
loaded anew finds it where it is. It runs at a lower priority, so that it never takes the processor
from a bench.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable
from dataclasses import dataclass, replace
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection, wait
from typing import Any, Generic, Literal, TypeVar

from benchtool.errors import BenchtoolError

T = TypeVar("T")

Tell = Callable[[str, float], None]
"""tell(what is being done, share of the whole from 0 to 1)"""

Status = Literal["running", "done", "failed", "cancelled"]

NICENESS = 5
"""Of the process, where the system knows such a thing; a guess that keeps a page smooth."""

GRACE_S = 2.0
"""How long a cancelled process may take to end before it is killed; a guess."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JobState(Generic[T]):
    """Say how a job stands.

    Attributes:
        status: running, done, failed or cancelled.
        what: what is being done, or was done last.
        share: of the whole, 0 to 1.
        stages: everything that was done so far, in order.
        result: of the work, once it is done.
        error: one sentence, where it failed.
    """

    status: Status = "running"
    what: str = "starting"
    share: float = 0.0
    stages: tuple[str, ...] = ()
    result: T | None = None
    error: str = ""

    @property
    def running(self) -> bool:
        """Whether there is more to come."""
        return self.status == "running"


class Job(Generic[T]):
    """Run a function of a module, with arguments that pickle, in a new process.

    Args:
        work: called as work(tell, *arguments); calls tell(what, share) whenever it likes.
        arguments: of the work.
    """

    def __init__(self, work: Callable[..., T], *arguments: Any) -> None:
        context = get_context("spawn")
        receiving, sending = context.Pipe(duplex=False)
        self._state: JobState[T] = JobState()
        self._changing = threading.Lock()
        self._process = context.Process(
            target=_run, args=(sending, work, arguments), daemon=True, name=work.__name__
        )
        self._process.start()
        sending.close()
        self._reader = threading.Thread(target=self._read, args=(receiving,), daemon=True)
        self._reader.start()

    @property
    def state(self) -> JobState[T]:
        """How it stands now."""
        return self._state

    def cancel(self) -> None:
        """End the process; nothing happens to a job that has ended already."""
        if not self._change(status="cancelled"):
            return
        self._process.terminate()
        self._process.join(GRACE_S)
        if self._process.is_alive():
            self._process.kill()

    def wait(self, timeout_s: float | None = None) -> JobState[T]:
        """Return how it stands once it has ended, or after so long."""
        self._reader.join(timeout_s)
        return self._state

    def _read(self, receiving: Connection) -> None:
        """Take messages until the process closes its end."""
        with receiving:
            while True:
                try:
                    kind, *said = receiving.recv()
                except (EOFError, OSError):
                    break
                self._take(kind, said)
        self._process.join()
        self._change(
            status="failed",
            error=f"the work ended without an answer (exit code {self._process.exitcode}), as "
            f"when memory runs out; ask for less, or close other programs",
        )

    def _take(self, kind: str, said: list[Any]) -> None:
        if kind == "tell":
            what, share = said
            stages = self._state.stages
            if stages[-1:] != (what,):
                stages = (*stages, what)
            self._change(what=what, share=share, stages=stages)
        elif kind == "done":
            self._change(status="done", share=1.0, result=said[0])
        else:
            self._change(status="failed", error=said[0])

    def _change(self, **changes: Any) -> bool:
        """Change the state of a job that still runs; say whether it did."""
        with self._changing:
            if not self._state.running:
                return False
            self._state = replace(self._state, **changes)
            return True


def _run(sending: Connection, work: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
    """Do the work in the new process and send what comes of it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the server's, which ends this process
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with contextlib.suppress(AttributeError, OSError):
        os.nice(NICENESS)

    def tell(what: str, share: float) -> None:
        sending.send(("tell", what, float(share)))

    try:
        message: tuple[str, Any] = ("done", work(tell, *arguments))
    except BenchtoolError as error:
        message = ("failed", str(error))
    except Exception as error:  # noqa: BLE001 -- whatever it is, the page must hear of it
        traceback.print_exc(file=sys.stderr)
        message = ("failed", fault_sentence(error))
    try:
        sending.send(message)
    except OSError:  # the server has gone
        return


def fault_sentence(error: Exception) -> str:
    """Say that a fault is benchtool's own; its traceback stands where the server was started."""
    summary = " ".join(str(error).split())
    return (
        f"a fault in benchtool itself, {type(error).__name__}: {summary}; please report it with "
        f"what was printed where benchtool web runs"
    )


def _end_with_parent() -> None:
    """End when the server is gone, however it went."""
    parent = parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)
