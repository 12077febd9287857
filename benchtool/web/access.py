"""Which requests the server answers: host names, origins and the token. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from ipaddress import ip_address
from secrets import compare_digest
from urllib.parse import urlsplit

LOOPBACK = frozenset({"127.0.0.1", "localhost", "::1"})  # names of the loopback address


@dataclass(frozen=True, slots=True, kw_only=True)
class RequestFacts:
    """Hold what a browser states about a request; empty strings where it states nothing."""

    host: str
    origin: str = ""
    site: str = ""
    mode: str = ""
    token: str = ""
    reads_only: bool = True
    is_socket: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Access:
    """Judge requests.

    Attributes:
        names: host names that are ours; another name may be a page elsewhere whose name was pointed
            at our address (DNS rebinding).
        any_address: take every numeric address for ours, for a server on all interfaces. An
            address cannot be pointed elsewhere.
        token: that a browser must have shown; None where only this machine can reach the server.
    """

    names: frozenset[str] = LOOPBACK
    any_address: bool = False
    token: str | None = None

    def refusal(self, request: RequestFacts) -> str | None:
        """Return why a request is refused, in one sentence, or None when it is not."""
        host = host_name(request.host)
        if host not in self.names and not (self.any_address and _is_address(host)):
            return (
                f"the request names the host {request.host!r}, which is none of its names; open "
                f"the address that benchtool web has printed"
            )
        if request.origin:
            if request.origin not in (f"http://{request.host}", f"https://{request.host}"):
                return f"a page of {request.origin!r} may not use this one; open this one by itself"
        elif request.is_socket or (not request.reads_only and request.site != "same-origin"):
            return (
                "a request that does not state from which page it comes is refused; use a browser"
            )
        if request.site in ("cross-site", "same-site") and request.mode != "navigate":
            return "another site's page may not use this one; open this one by itself"
        if self.token is not None and not self.is_token(request.token):
            return (
                "the token is missing or wrong; open the whole address that benchtool web has "
                "printed, with its token"
            )
        return None

    def is_token(self, given: str) -> bool:
        """Return whether this is the token; the time taken does not depend on it."""
        return self.token is not None and compare_digest(given.encode(), self.token.encode())


def _is_address(host: str) -> bool:
    try:
        return bool(ip_address(host))
    except ValueError:
        return False


def host_name(host: str) -> str:
    """Return the name in a Host header, lower case, without port or brackets; or ""."""
    if not host or set(host) & set("/?#@\\ \t"):
        return ""
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""


def is_loopback(host: str) -> bool:
    """Return whether a server bound to this host can only be reached from the same machine."""
    return host == "localhost" or (_is_address(host) and ip_address(host).is_loopback)
