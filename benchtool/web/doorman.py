"""Stand before every request and websocket: refuse what `access` refuses, hand out the cookie."""

from __future__ import annotations

from http.cookies import CookieError, SimpleCookie
from typing import TYPE_CHECKING
from urllib.parse import parse_qs, urlencode

from starlette.responses import PlainTextResponse, RedirectResponse, Response

from benchtool.web.access import Access, Asked

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

HEADERS = (
    (b"x-frame-options", b"DENY"),
    (b"content-security-policy", b"frame-ancestors 'none'"),
    (b"referrer-policy", b"no-referrer"),
    (b"x-content-type-options", b"nosniff"),
)
"""Nobody puts this page into a frame and lets people press what they do not see; nobody is told
its address."""

REFUSED = 403
CLOSED = 1008
"""Close code of a websocket that breaks the rules (RFC 6455, section 7.4.1)."""


class Doorman:
    """Guard an application.

    Args:
        app: what is guarded.
        access: the rules.
        cookie: name of the cookie that keeps the token. With the port in it: browsers share
            cookies between the ports of a host.
    """

    def __init__(self, app: ASGIApp, access: Access, cookie: str) -> None:
        self._app, self._access, self._cookie = app, access, cookie

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = {
            name.decode("latin-1"): value.decode("latin-1") for name, value in scope["headers"]
        }
        asked = _asked(scope, headers, self._cookie)
        if scope["type"] == "websocket":
            if self._access.refusal(asked) is None:
                await self._app(scope, receive, send)
            else:
                await receive()
                await send({"type": "websocket.close", "code": CLOSED})
            return
        query = parse_qs(scope["query_string"].decode("latin-1"))
        shown = query.pop("token", [""])[0]
        if shown and self._access.is_token(shown):
            asked = _asked(scope, {**headers, "cookie": f"{self._cookie}={shown}"}, self._cookie)
        refusal = self._access.refusal(asked)
        answer: Response | None = None
        if refusal is not None:
            answer = PlainTextResponse(f"benchtool: {refusal}\n", REFUSED)
        elif shown and self._access.token is not None:
            # The token leaves the address bar, and with it the history and what people copy.
            rest = urlencode(query, doseq=True)
            answer = RedirectResponse(scope["path"] + (f"?{rest}" if rest else ""), 303)
            answer.set_cookie(self._cookie, shown, httponly=True, samesite="strict")
        await (answer or self._app)(scope, receive, _with_headers(send))


def _asked(scope: Scope, headers: dict[str, str], cookie: str) -> Asked:
    is_socket = scope["type"] == "websocket"
    return Asked(
        host=headers.get("host", ""),
        origin=headers.get("origin", ""),
        site=headers.get("sec-fetch-site", ""),
        mode=headers.get("sec-fetch-mode", ""),
        token=_cookie(headers.get("cookie", ""), cookie),
        reads_only=not is_socket and scope["method"] in ("GET", "HEAD"),
        is_socket=is_socket,
    )


def _cookie(header: str, name: str) -> str:
    try:
        found = SimpleCookie(header).get(name)
    except CookieError:
        return ""
    return found.value if found else ""


def _with_headers(send: Send) -> Send:
    async def sent(message: Message) -> None:
        if message["type"] == "http.response.start":
            message = {**message, "headers": [*message.get("headers", ()), *HEADERS]}
        await send(message)

    return sent
