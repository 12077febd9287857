"""Access rules of the server: host names, origins and the token. No input or output."""

from __future__ import annotations

from dataclasses import dataclass
from ipaddress import ip_address
from secrets import compare_digest
from urllib.parse import urlsplit

LOOPBACK = frozenset({"127.0.0.1", "localhost", "::1"})  # names of the loopback address


@dataclass(frozen=True, slots=True, kw_only=True)
class RequestInfo:
    """Security headers of a request; "" if absent."""

    host: str
    origin: str = ""
    site: str = ""
    mode: str = ""
    token: str = ""
    reads_only: bool = True
    is_socket: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Access:
    """Access rules of a server.

    Attributes:
        names: host names of the server; another name may be an attacker's (DNS rebinding).
        any_address: accept every numeric address as host, for a server on all interfaces;
            numeric addresses cannot be rebound.
        token: required token; None if only this machine can reach the server.
    """

    names: frozenset[str] = LOOPBACK
    any_address: bool = False
    token: str | None = None

    def find_rejection(self, request: RequestInfo) -> str | None:
        """Return the message if a request is rejected, else None."""
        host = host_name(request.host)
        if host not in self.names and not (self.any_address and _is_address(host)):
            return (
                f"host {request.host!r} is not a name of this server; open the address printed by "
                f"benchtool web"
            )
        if request.origin:
            if request.origin not in (f"http://{request.host}", f"https://{request.host}"):
                return f"requests from {request.origin!r} are not allowed; open this page directly"
        elif request.is_socket or (not request.reads_only and request.site != "same-origin"):
            return "the request has no Origin header; use a browser"
        if request.site in ("cross-site", "same-site") and request.mode != "navigate":
            return "requests from other sites are not allowed; open this page directly"
        if self.token is not None and not self.is_token(request.token):
            return (
                "the token is missing or wrong; open the complete address printed by benchtool "
                "web, including its token"
            )
        return None

    def is_token(self, text: str) -> bool:
        """Return whether a text is the token, compared in constant time."""
        return self.token is not None and compare_digest(text.encode(), self.token.encode())


def _is_address(host: str) -> bool:
    try:
        return bool(ip_address(host))
    except ValueError:
        return False


def host_name(host: str) -> str:
    """Return the name in a Host header in lower case, without port and brackets; "" if invalid."""
    if not host or set(host) & set("/?#@\\ \t"):
        return ""
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""


def is_loopback(host: str) -> bool:
    """Return whether only the same machine can reach a server bound to this host."""
    return host == "localhost" or (_is_address(host) and ip_address(host).is_loopback)
