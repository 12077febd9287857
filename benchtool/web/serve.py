"""Web server on the loopback address, or on another address with a token."""

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
    """Open an address in the user's browser.

    Every user of the machine can read command lines, so an address with a token is opened through
    a redirect file that only this user can read. The caller deletes the returned file.
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


DEFAULT_PORT = 8460  # assumed
TOKEN_BYTES = 24
ALL_INTERFACES = frozenset({"0.0.0.0", "::"})  # noqa: S104 -- compared with, not bound to


def serve(
    runs: Path,
    host: str,
    port: int | None,
    announce: Callable[[str], None],
    *,
    requires_token: bool = False,
) -> None:
    """Serve the page until Ctrl-C; `announce` gets its address before the framework is loaded.

    Port 0 is a free port, None is DEFAULT_PORT or, if taken, a free port.
    """
    listening = listen(host, port)
    port = listening.getsockname()[1]
    access = build_access(host, requires_token=requires_token)
    name = "127.0.0.1" if host in ALL_INTERFACES else host
    url = f"http://{f'[{name}]' if ':' in name else name}:{port}/"
    url_with_token = f"{url}?token={access.token}" if access.token else url
    # The bench process imports its modules while this one imports the web framework.
    token = access.token or secrets.token_urlsafe(TOKEN_BYTES)
    stop_endpoint = StopEndpoint(_create_socket(host, 0), token)
    process = ProcessHandle(stop_endpoint)
    process.start()
    try:
        announce(url_with_token)
        with quick_import():
            from benchtool.web.application import run_application
        run_application(runs, listening, access, process)
    finally:
        process.end(0.0)
        listening.close()
        stop_endpoint.listening.close()


def build_access(host: str, *, requires_token: bool = False) -> Access:
    """Return the access rules of a server bound to a host; loopback needs no token by default."""
    if is_loopback(host):
        token = secrets.token_urlsafe(TOKEN_BYTES) if requires_token else None
        return Access(names=LOOPBACK | {host}, token=token)
    names = {socket.gethostname().lower(), socket.getfqdn().lower(), host.lower()}
    return Access(
        names=LOOPBACK | names - ALL_INTERFACES,
        any_address=True,
        token=secrets.token_urlsafe(TOKEN_BYTES),
    )


def listen(host: str, port: int | None) -> socket.socket:
    """Return a listening socket; raise if the address is not available."""
    with suppress(OSError):
        return _create_socket(host, DEFAULT_PORT if port is None else port)
    try:
        return _create_socket(host, 0 if port is None else port)
    except OSError as error:
        cause = os.strerror(error.errno) if error.errno else error
        raise InputError(
            f"port {port} of host {host} is not available: {cause}; use another --host or --port"
        ) from error


def _create_socket(host: str, port: int) -> socket.socket:
    if ":" not in host:
        return socket.create_server((host, port))
    dual = socket.has_dualstack_ipv6()
    return socket.create_server((host, port), family=socket.AF_INET6, dualstack_ipv6=dual)
