"""Where a virtual autopilot is served, and the address that a host opens for it."""

from __future__ import annotations

from pathlib import Path

from benchtool.bench.mavlink.settings import DEFAULT_BAUD, LOOPBACK
from benchtool.bench.rcbenchmark.udp_link import UdpLink
from benchtool.core.errors import InputError
from benchtool.virtual.server_links import PtyLink, ServerLink, TcpLink

USUAL_PORT = 14550
"""Where ground stations listen."""


def autopilot_link(text: str, symlink: Path | None = None) -> ServerLink:
    """Return the link that follows `mavlink` in `--link`.

    Nothing stands for UDP to port 14550 of this computer; `:pty`, `:tcp:5760`, `:udpout:HOST:PORT`
    (sends there) and `:udpin:PORT` (waits there) are the others.

    Raises:
        InputError: it names none.
    """
    kind, _, place = text.removeprefix(":").partition(":")
    if kind == "pty" and not place:
        return PtyLink(symlink)
    if symlink is not None:
        raise InputError("--symlink goes with --link mavlink:pty only; leave it out")
    host, _, port = (place or f"{LOOPBACK}:{USUAL_PORT}").rpartition(":")
    if kind in ("", "udpout", "udpin", "tcp") and port.isdecimal():
        if kind == "tcp":
            return TcpLink(host or LOOPBACK, int(port))
        return UdpLink(host or LOOPBACK, int(port), listen=kind == "udpin")
    raise InputError(
        f"link 'mavlink:{text.removeprefix(':')}' is none; known: mavlink, mavlink:pty, "
        f"mavlink:tcp:PORT, mavlink:udpout:HOST:PORT, mavlink:udpin:PORT"
    )


def host_address(link: ServerLink, n_rotors: int, options: str = "") -> str:
    """Return the address that a host opens: link, and how many rotors hang on the autopilot."""
    place = link.address + (f":{DEFAULT_BAUD}" if link.address.startswith("serial:") else "")
    return f"mavlink:{place}?rotors={n_rotors}{options}"
