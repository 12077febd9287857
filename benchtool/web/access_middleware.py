"""Check every request and websocket before the application; set the cookie of the token."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from html import escape
from typing import TYPE_CHECKING
from urllib.parse import parse_qs, urlencode

from starlette.requests import HTTPConnection
from starlette.responses import HTMLResponse, PlainTextResponse, Response

from benchtool.data.run.runs_folder import MAX_UPLOAD_BYTES
from benchtool.web.access import Access, RequestFacts, host_name

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

HEADERS = (  # no other site can frame this page, nor learn its address
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
"""Nothing is loaded from, or sent to, anywhere else. NiceGUI runs inline scripts and evaluates
text, so these two are allowed."""

MAX_BODY_BYTES = MAX_UPLOAD_BYTES + 100_000  # a table and the form around it
WRONG_TOKEN_DELAY_S = 1.0  # Wrong tokens are answered one after another, so much apart; a choice

MAX_WAITING = 50  # wrong tokens that wait for their answer
REFUSED = 403
TOO_LARGE = 413
TOO_MANY = 429
CLOSED = 1008  # Close code of a websocket that breaks the rules (RFC 6455, section 7.4.1)


class AccessMiddleware:
    """Guard an application.

    The cookie's name has the port in it: browsers share cookies between the ports of a host.
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
        self._turn = asyncio.Lock()
        self._waiting = 0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        given = HTTPConnection(scope)
        query = parse_qs(scope["query_string"].decode("latin-1"))
        shown = query.pop("token", [""])[0] if scope["type"] == "http" else ""
        right = bool(shown) and self._access.is_token(shown)
        request = RequestFacts(
            host=given.headers.get("host", ""),
            origin=given.headers.get("origin", ""),
            site=given.headers.get("sec-fetch-site", ""),
            mode=given.headers.get("sec-fetch-mode", ""),
            token=shown if right else given.cookies.get(self._cookie, ""),
            reads_only=scope.get("method") in ("GET", "HEAD"),
            is_socket=scope["type"] == "websocket",
        )
        refusal = self._access.refusal(request)
        if scope["type"] == "websocket":
            if refusal is None:
                await self._app(scope, receive, send)
            else:
                if request.token:
                    await self._slow_down()
                await receive()
                await send({"type": "websocket.close", "code": CLOSED})
            return
        answer: Response | None = None
        if refusal is not None:
            guessed = self._access.token is not None and bool(shown or request.token)
            status = REFUSED
            if guessed and not await self._slow_down():
                status, refusal = TOO_MANY, "too many wrong tokens; try again later"
            answer = PlainTextResponse(f"benchtool: {refusal}\n", status)
        elif shown and self._access.token is not None:
            # The token leaves the address bar, and with it the history and what people copy.
            rest = urlencode(query, doseq=True)
            target = escape("/" + scope["path"].lstrip("/") + (f"?{rest}" if rest else ""))
            # From a page of our own: a browser that came from another site
            # does not send a strict cookie where it is merely redirected.
            answer = HTMLResponse(
                f'<!doctype html><meta http-equiv="refresh" content="0; url={target}">',
                headers={"cache-control": "no-store"},
            )
            answer.set_cookie(self._cookie, shown, httponly=True, samesite="strict")
        policy = "default-src 'none'"
        if refusal is None:
            name = host_name(request.host)
            name = f"[{name}]" if ":" in name else name
            stop = "" if self._stop_port is None else f" http://{name}:{self._stop_port}"
            policy = POLICY.format(host=request.host, stop=stop)
        body = SizeLimitedBody(receive, _with_headers(send, policy))
        try:
            await (answer or self._app)(scope, body.receive, body.send)
        except BodyTooLarge:
            pass

    async def _slow_down(self) -> bool:
        """Wait until a wrong token is answered; return whether there was room to wait."""
        if self._waiting >= MAX_WAITING:
            return False
        self._waiting += 1
        try:
            async with self._turn:
                await self._sleep(WRONG_TOKEN_DELAY_S)
        finally:
            self._waiting -= 1
        return True


class BodyTooLarge(Exception):
    """Break off an application that reads a body beyond its bound."""


class SizeLimitedBody:
    """Count a request's body while it arrives; beyond the bound the answer is ours."""

    def __init__(self, receive: Receive, send: Send) -> None:
        self._receive, self._send = receive, send
        self._bytes = 0
        self._begun = False

    async def receive(self) -> Message:
        """Return the next part.

        Raises:
            BodyTooLarge: it was answered that the body is too large.
        """
        message = await self._receive()
        self._bytes += len(message.get("body", b""))
        if self._bytes > MAX_BODY_BYTES:
            if not self._begun:
                text = f"benchtool: more than {MAX_BODY_BYTES / 1e6:.1f} MB were sent; send less\n"
                headers = [(b"content-type", b"text/plain"), (b"connection", b"close")]
                await self.send(
                    {"type": "http.response.start", "status": TOO_LARGE, "headers": headers}
                )
                await self._send({"type": "http.response.body", "body": text.encode()})
            raise BodyTooLarge
        return message

    async def send(self, message: Message) -> None:
        """Send on, unless the body was too large."""
        if self._bytes <= MAX_BODY_BYTES or not self._begun:
            self._begun = True
            await self._send(message)


def _with_headers(send: Send, policy: str) -> Send:
    added = (*HEADERS, (b"content-security-policy", policy.encode("latin-1")))

    async def sent(message: Message) -> None:
        if message["type"] == "http.response.start":
            message = {**message, "headers": [*message.get("headers", ()), *added]}
        await send(message)

    return sent
