"""Serve the page: on the loopback address, or elsewhere behind a token."""

from __future__ import annotations

import os
import secrets
import socket
import webbrowser
from collections.abc import Callable
from contextlib import suppress
from html import escape
from pathlib import Path

from benchtool.core.errors import InputError
from benchtool.data.run.state import state_folder
from benchtool.web.access import LOOPBACK, Access, is_loopback
from benchtool.web.bench_process.spawn import ProcessHandle, StopEndpoint, quick_import


def open_page(
    address: str,
    folder: Path | None = None,
    open_address: Callable[[str], object] = webbrowser.open,
) -> Path | None:
    """Open an address in the browser of this user.

    A command line can be read by every user of the machine. So an address with a token is not put
    on the browser's; it stands in a file that only this user can read and that leads on to it.

    Args:
        address: of the page, with its token where it wants one.
        folder: for that file; that of this user's state when None.

    Returns:
        The file, to be deleted when the token has expired; None where there is none.
    """
    if "token=" not in address:
        open_address(address)
        return None
    folder = folder or state_folder()
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / f"open-{os.getpid()}.html"
    file.unlink(missing_ok=True)
    with open(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as text:
        text.write(
            '<!doctype html><meta name="referrer" content="no-referrer">'
            f'<meta http-equiv="refresh" content="0; url={escape(address)}">'
        )
    open_address(file.as_uri())
    return file


PORT = 8460  # Where the page is when nobody names a port and this one is free; a choice

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
        port: to bind to; PORT or else a free one when None, a free one when 0.
        announce: is given the address of the page as soon as a browser may open it; the answer
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
    token = access.token or secrets.token_urlsafe(TOKEN_BYTES)
    stop_endpoint = StopEndpoint(_listening(host, 0), token)
    process = ProcessHandle(stop_endpoint)
    process.start()
    try:
        announce(opened)
        with quick_import():
            from benchtool.web.application import run_application
        run_application(runs, listening, access, process)
    finally:
        process.end(0.0)
        listening.close()
        stop_endpoint.listening.close()


def access_for(host: str, *, wants_token: bool = False) -> Access:
    """Return the rules of a server bound to a host; with a token unless only this machine can
    reach it.
    """
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
        why = os.strerror(error.errno) if error.errno else error
        raise InputError(
            f"nothing can be served on {host} port {port}: {why}; name another with --host and "
            f"--port"
        ) from error


def _listening(host: str, port: int) -> socket.socket:
    if ":" not in host:
        return socket.create_server((host, port))
    both = socket.has_dualstack_ipv6()
    return socket.create_server((host, port), family=socket.AF_INET6, dualstack_ipv6=both)
