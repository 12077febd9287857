"""Access rules of the server (host names, origins, token) and the middleware that applies them."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from html import escape
from http import HTTPStatus
from ipaddress import ip_address
from secrets import compare_digest
from typing import TYPE_CHECKING
from urllib.parse import parse_qs, urlencode, urlsplit

from starlette.requests import HTTPConnection
from starlette.responses import HTMLResponse, PlainTextResponse, Response

from benchtool.data.run.runs_folder import MAX_UPLOAD_BYTES

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send


LOOPBACK = frozenset({"127.0.0.1", "localhost", "::1"})  # names of the loopback address


@dataclass(frozen=True, slots=True, kw_only=True)
class Access:
    """Access rules of a server."""

    names: frozenset[str] = LOOPBACK  # other host names may be an attacker's (DNS rebinding)
    any_address: bool = False  # accept numeric addresses as host; they cannot be rebound
    token: str | None = None  # None if only this machine can reach the server

    def find_rejection(
        self, headers: Mapping[str, str], token: str, *, reads_only: bool, is_socket: bool
    ) -> str | None:
        """Return the message if a request is rejected, else None."""
        host, origin = headers.get("host", ""), headers.get("origin", "")
        site = headers.get("sec-fetch-site", "")
        name = host_name(host)
        if name not in self.names and not (self.any_address and _is_address(name)):
            return (
                f"host {host!r} is not a name of this server; open the address printed by "
                f"benchtool web"
            )
        if origin:
            if origin not in (f"http://{host}", f"https://{host}"):
                return f"requests from {origin!r} are not allowed; open this page directly"
        elif is_socket or (not reads_only and site != "same-origin"):
            return "the request has no Origin header; use a browser"
        is_navigation = headers.get("sec-fetch-mode", "") == "navigate"
        if site in ("cross-site", "same-site") and not is_navigation:
            return "requests from other sites are not allowed; open this page directly"
        if self.token is not None and not self.is_token(token):
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


HEADERS = (  # prevent framing by other sites and disclosure of the address
    (b"x-frame-options", b"DENY"),
    (b"referrer-policy", b"no-referrer"),
    (b"x-content-type-options", b"nosniff"),
)

POLICY = (
    "default-src 'none'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; worker-src 'self'; "
    "style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; font-src 'self' data:; "
    "connect-src 'self' ws://{host} wss://{host}{stop}; form-action 'self'; base-uri 'none'; "
    "frame-ancestors 'none'"
)
"""Own content only; NiceGUI needs inline scripts and eval."""

MAX_BODY_BYTES = MAX_UPLOAD_BYTES + 100_000  # a table and its multipart form
WRONG_TOKEN_DELAY_S = 1.0  # between responses to wrong tokens; assumed
MAX_WAITING = 50  # delayed responses to wrong tokens
POLICY_VIOLATION = 1008  # close code of a websocket (RFC 6455, section 7.4.1)


class AccessMiddleware:
    """ASGI middleware with the access rules.

    The cookie's name must contain the port: browsers share cookies between the ports of a host.
    """

    def __init__(
        self,
        app: ASGIApp,
        access: Access,
        cookie: str,
        sleep: Callable[[float], Awaitable[object]] = asyncio.sleep,
        stop_port: int | None = None,
    ) -> None:
        self._app, self._access, self._cookie, self._sleep = app, access, cookie, sleep
        self._stop_port = stop_port
        self._delay_lock = asyncio.Lock()
        self._waiting = 0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        connection = HTTPConnection(scope)
        query = parse_qs(scope["query_string"].decode("latin-1"))
        url_token = query.pop("token", [""])[0] if scope["type"] == "http" else ""
        is_valid = bool(url_token) and self._access.is_token(url_token)
        token = url_token if is_valid else connection.cookies.get(self._cookie, "")
        rejection = self._access.find_rejection(
            connection.headers,
            token,
            reads_only=scope.get("method") in ("GET", "HEAD"),
            is_socket=scope["type"] == "websocket",
        )
        if scope["type"] == "websocket":
            if rejection is None:
                await self._app(scope, receive, send)
            else:
                if token:
                    await self._delay()
                await receive()
                await send({"type": "websocket.close", "code": POLICY_VIOLATION})
            return
        response: Response | None = None
        if rejection is not None:
            is_token_guess = self._access.token is not None and bool(url_token or token)
            status = HTTPStatus.FORBIDDEN
            if is_token_guess and not await self._delay():
                status = HTTPStatus.TOO_MANY_REQUESTS
                rejection = "too many wrong tokens; try again later"
            response = PlainTextResponse(f"benchtool: {rejection}\n", status)
        elif url_token and self._access.token is not None:
            # Remove the token from the address bar and the history.
            query_text = urlencode(query, doseq=True)
            path = "/" + scope["path"].lstrip("/")
            target = escape(path + (f"?{query_text}" if query_text else ""))
            # Refresh by a page of this server: after a link from another site, browsers
            # do not send a strict cookie with a redirect.
            response = HTMLResponse(
                f'<!doctype html><meta http-equiv="refresh" content="0; url={target}">',
                headers={"cache-control": "no-store"},
            )
            response.set_cookie(self._cookie, url_token, httponly=True, samesite="strict")
        policy = "default-src 'none'"
        if rejection is None:
            host = connection.headers["host"]
            name = host_name(host)
            name = f"[{name}]" if ":" in name else name
            stop = "" if self._stop_port is None else f" http://{name}:{self._stop_port}"
            policy = POLICY.format(host=host, stop=stop)
        exchange = GuardedExchange(receive, send, policy)
        with suppress(BodyTooLarge):
            await (response or self._app)(scope, exchange.receive, exchange.send)

    async def _delay(self) -> bool:
        """Delay the response to a wrong token; return False if too many are waiting."""
        if self._waiting >= MAX_WAITING:
            return False
        self._waiting += 1
        try:
            async with self._delay_lock:
                await self._sleep(WRONG_TOKEN_DELAY_S)
        finally:
            self._waiting -= 1
        return True


class BodyTooLarge(Exception):
    """The application has read a body beyond the size limit."""


class GuardedExchange:
    """Request with a size limit, and response with security headers.

    Above the limit, the middleware sends the response.
    """

    def __init__(self, receive: Receive, send: Send, policy: str) -> None:
        self._receive, self._send = receive, send
        self._headers = (*HEADERS, (b"content-security-policy", policy.encode("latin-1")))
        self._n_bytes = 0
        self._has_started = False

    async def receive(self) -> Message:
        """Return the next part; raise `BodyTooLarge` after the error response."""
        message = await self._receive()
        self._n_bytes += len(message.get("body", b""))
        if self._n_bytes > MAX_BODY_BYTES:
            if not self._has_started:
                text = f"benchtool: request is too large; allowed: {MAX_BODY_BYTES / 1e6:.1f} MB\n"
                headers = [(b"content-type", b"text/plain"), (b"connection", b"close")]
                status = HTTPStatus.REQUEST_ENTITY_TOO_LARGE
                start = {"type": "http.response.start", "status": status, "headers": headers}
                await self.send(start)
                await self._send({"type": "http.response.body", "body": text.encode()})
            raise BodyTooLarge
        return message

    async def send(self, message: Message) -> None:
        """Forward a message unless the body is too large."""
        if self._n_bytes <= MAX_BODY_BYTES or not self._has_started:
            self._has_started = True
            if message["type"] == "http.response.start":
                message = {**message, "headers": [*message.get("headers", ()), *self._headers]}
            await self._send(message)
