"""STOP listener of a process that owns a bench: HTTP on its own port, in separate threads.

A page's worker and `benchtool stop` send `POST /stop` with the token as body. Zero is commanded
before the answer; the answer to `POST /stop?wait` follows the standstill check and reports it.
"""

from __future__ import annotations

import json
import os
import secrets
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from http.client import HTTPConnection, HTTPException
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from benchtool.core.errors import BenchtoolError
from benchtool.data.atomic import make_folder, read_json
from benchtool.data.run.state import state_folder

if TYPE_CHECKING:
    from benchtool.bench.guard import GuardedBench

VIRTUAL_CLOCKS = ("sim:", "replay:")  # addresses of benches without a motor
TOKEN_BYTES = 24
MAX_BODY_BYTES = 200
MAX_THREADS = 64  # of the process; more requests are closed without an answer; assumed
REQUEST_TIMEOUT_S = 2.0  # for the lines of a request; assumed
STANDSTILL_TIMEOUT_S = 6.0  # above SPIN_DOWN_S of bench.driven, the longest standstill check
ANSWER_TIMEOUT_S = STANDSTILL_TIMEOUT_S + REQUEST_TIMEOUT_S
POLL_INTERVAL_S = 0.02


class StopReport(NamedTuple):
    """Result of a stop; `text` is the standstill check's sentence."""

    standing: bool
    text: str


def report_standstill(bench: GuardedBench | None) -> StopReport | None:
    """Return the standstill of a bench; None while rotors may still coast."""
    if bench is None:
        return StopReport(True, "no motor is driven")
    state = bench.standstill
    if state is None or not state.is_confirmed:
        return None
    return StopReport(True, state.text or "no motor was driven")


class StopListener:
    """Listener for STOP, open within its `with` block.

    Args:
        listening: bound socket; closed with the listener.
        stop: called with the source of the stop, from the listener's threads.
        report: polled after a stop until it returns a report.
    """

    def __init__(
        self,
        listening: socket.socket,
        token: str,
        stop: Callable[[str], object],
        report: Callable[[], StopReport | None],
    ) -> None:
        self.token = token
        self._stop, self._report = stop, report
        self._is_over = False
        self._server = _Server(("", 0), partial(_Handler, self), bind_and_activate=False)
        self._server.socket.close()
        self._server.socket = listening

    @property
    def endpoint(self) -> dict[str, Any]:
        """Host and port at which this machine reaches the listener, and the token."""
        host, port = self._server.socket.getsockname()[:2]
        host = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(host, host)  # noqa: S104 -- compared
        return {"host": host, "port": port, "token": self.token}

    def __enter__(self) -> Self:
        serve = self._server.serve_forever
        threading.Thread(target=serve, args=(POLL_INTERVAL_S,), name="stop", daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        """Answer the requests that wait for the standstill check, then close."""
        self._is_over = True
        self._server.shutdown()
        self._server.server_close()

    def answer(self, path: str, token: bytes) -> tuple[int, bytes]:
        """Stop if the token is correct; return status and body of the answer."""
        if not secrets.compare_digest(token, self.token.encode()):
            return 403, b""
        if path != "/stop?wait":
            self._stop("the page")
            return 200, b"stopped"
        self._stop("benchtool stop")
        return 200, json.dumps(self._wait()._asdict()).encode()

    def _wait(self) -> StopReport:
        deadline_s = time.monotonic() + STANDSTILL_TIMEOUT_S
        while time.monotonic() < deadline_s:
            is_over = self._is_over
            if (report := self._report()) is not None:
                return report
            if is_over:
                break
            time.sleep(POLL_INTERVAL_S)
        return StopReport(
            False, "standstill not confirmed; check the rotors and cut the power if they turn"
        )


class _Server(ThreadingHTTPServer):
    daemon_threads = False  # closing waits for their answers

    def verify_request(self, *_: object) -> bool:
        return threading.active_count() < MAX_THREADS


class _Handler(BaseHTTPRequestHandler):
    timeout = REQUEST_TIMEOUT_S

    def __init__(self, listener: StopListener, *arguments: Any) -> None:
        self._listener = listener
        super().__init__(*arguments)

    def do_POST(self) -> None:
        length = self.headers.get("Content-Length", "")
        n_bytes = min(int(length), MAX_BODY_BYTES) if length.isdecimal() else 0
        status, body = self._listener.answer(self.path, self.rfile.read(n_bytes))
        self.send_response(status)
        self.send_header("Content-Length", str(len(body)))
        self.send_header("Access-Control-Allow-Origin", "*")  # the page is on another port
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *arguments: object) -> None:
        """No-op: the terminal belongs to the run."""


@contextmanager
def announce(address: str, listener: StopListener) -> Iterator[None]:
    """Write the endpoint for `benchtool stop`, readable by this user only.

    If the state folder cannot be written, `benchtool stop` does not find the bench.
    """
    path = stop_folder() / f"{os.getpid()}-{secrets.token_hex(4)}.json"
    with suppress(OSError):
        make_folder(path.parent)
        with open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
            json.dump({"address": address, **listener.endpoint}, file)
    try:
        yield
    finally:
        with suppress(OSError):
            path.unlink(missing_ok=True)


def stop_folder() -> Path:
    """Return the folder of the files that `announce` writes."""
    return state_folder() / "stop"


@contextmanager
def accept_stops(bench: GuardedBench, address: str) -> Iterator[GuardedBench]:
    """Open a guarded bench that `benchtool stop` can stop from another process."""
    if address.startswith(VIRTUAL_CLOCKS):
        with bench:
            yield bench
        return
    listener = StopListener(
        socket.create_server(("127.0.0.1", 0)),
        secrets.token_urlsafe(TOKEN_BYTES),
        lambda source: bench.request_stop(f"stopped by {source}"),
        lambda: report_standstill(bench),
    )
    with listener, announce(address, listener), bench:
        yield bench


class AnnouncedBench(NamedTuple):
    """Bench of this user on this machine that listens for STOP."""

    address: str
    host: str
    port: int
    token: str
    file: Path

    def stop(self) -> StopReport:
        """Stop the bench and wait for its standstill check."""
        connection = HTTPConnection(self.host, self.port, timeout=ANSWER_TIMEOUT_S)
        try:
            connection.request("POST", "/stop?wait", self.token.encode())
            return StopReport(**json.loads(connection.getresponse().read()))
        except ConnectionRefusedError:
            self.file.unlink(missing_ok=True)
            return StopReport(False, "its process has ended; standstill not confirmed")
        except (OSError, HTTPException, ValueError) as error:
            return StopReport(False, f"no answer ({error}); cut the power")
        finally:
            connection.close()


def find_benches() -> list[AnnouncedBench]:
    """Return the benches that listen for STOP; incomplete files are ignored."""
    benches = []
    for file in sorted(stop_folder().glob("*.json")):
        with suppress(BenchtoolError, TypeError):
            benches.append(AnnouncedBench(**read_json(file), file=file))
    return benches
