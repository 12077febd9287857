"""Serve the page: on the loopback address, or elsewhere behind a token."""

from __future__ import annotations

import secrets
import socket
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from benchtool.errors import InputError
from benchtool.web.access import LOOPBACK, Access, is_loopback
from benchtool.web.bench_process import BenchProcess
from benchtool.web.quick_import import quick_import

PORT = 8460
"""Where the page is when nobody names a port and this one is free; a choice."""

TOKEN_BYTES = 24

EVERYWHERE = frozenset({"0.0.0.0", "::"})  # noqa: S104 -- compared with, not bound to


def serve(
    runs: Path,
    host: str,
    port: int | None,
    announce: Callable[[str], None],
    *,
    wants_token: bool = False,
) -> None:
    """Serve the page until Ctrl-C.

    Args:
        runs: folder of runs, the only one that the page reads and writes.
        host: address to bind to.
        port: to bind to; PORT or else a free one when None, a free one when 0.
        announce: is given the address of the page as soon as a browser may ask for it; the answer
            comes a moment later.
        wants_token: demand the token of this machine's users, too.

    Raises:
        InputError: the address cannot be bound to.
    """
    listening = listen(host, port)
    port = listening.getsockname()[1]
    access = access_for(host, wants_token=wants_token)
    shown = "127.0.0.1" if host in EVERYWHERE else host
    url = f"http://{f'[{shown}]' if ':' in shown else shown}:{port}/"
    opened = f"{url}?token={access.token}" if access.token else url
    # The two import side by side: the bench process what it needs, this one the web framework.
    process = BenchProcess()
    process.start()
    try:
        announce(opened)
        with quick_import():
            from benchtool.web.application import run_application
        run_application(runs, listening, access, process)
    finally:
        process.end(0.0)
        listening.close()


def access_for(host: str, *, wants_token: bool = False) -> Access:
    """Return who may ask a server bound to a host; a token is made unless only this machine can."""
    if is_loopback(host):
        token = secrets.token_urlsafe(TOKEN_BYTES) if wants_token else None
        return Access(names=LOOPBACK | {host}, token=token)
    own = {socket.gethostname().lower(), socket.getfqdn().lower(), host.lower()}
    return Access(
        names=LOOPBACK | own - EVERYWHERE,
        any_address=True,
        token=secrets.token_urlsafe(TOKEN_BYTES),
    )


def listen(host: str, port: int | None) -> socket.socket:
    """Return a socket that listens where the page is to be.

    Raises:
        InputError: the port is taken, or the host is not ours.
    """
    with suppress(OSError):
        return _listening(host, PORT if port is None else port)
    try:
        return _listening(host, 0 if port is None else port)
    except OSError as error:
        raise InputError(
            f"nothing can be served on {host} port {port}: {error.strerror or error}; name another "
            f"with --host and --port"
        ) from error


def _listening(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    made = socket.socket(family, socket.SOCK_STREAM)
    try:
        if sys.platform != "win32":
            made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        made.bind((host, port))
        made.listen()
    except BaseException:
        made.close()
        raise
    made.set_inheritable(False)
    return made
