from __future__ import annotations

import asyncio
from typing import Any

from benchtool.web.access import Access
from benchtool.web.doorman import Doorman

HOST = (b"host", b"127.0.0.1:8460")


def ask(access: Access, scope: dict[str, Any]) -> tuple[list[dict[str, Any]], list[str]]:
    """Return what is sent for a request, and which paths the application behind was asked for."""
    sent: list[dict[str, Any]] = []
    behind: list[str] = []

    async def app(scope: Any, receive: Any, send: Any) -> None:
        behind.append(scope.get("path", scope["type"]))
        if scope["type"] == "http":
            await send({"type": "http.response.start", "status": 200, "headers": []})
            await send({"type": "http.response.body", "body": b"page"})
        elif scope["type"] == "websocket":
            await send({"type": "websocket.accept"})

    async def receive() -> dict[str, Any]:
        return {"type": "websocket.connect"}

    async def send(message: Any) -> None:
        sent.append(message)

    asyncio.run(Doorman(app, access, "benchtool-1")(scope, receive, send))
    return sent, behind


def http(path: str = "/", query: bytes = b"", *headers: tuple[bytes, bytes]) -> dict[str, Any]:
    return {
        "type": "http",
        "method": "GET",
        "path": path,
        "query_string": query,
        "headers": [HOST, *headers],
    }


def headers_of(sent: list[dict[str, Any]]) -> dict[bytes, bytes]:
    return dict(sent[0]["headers"])


def test_what_is_let_in_cannot_be_framed() -> None:
    sent, behind = ask(Access(), http())
    assert behind == ["/"]
    assert sent[0]["status"] == 200
    assert headers_of(sent)[b"x-frame-options"] == b"DENY"
    assert headers_of(sent)[b"content-security-policy"] == b"frame-ancestors 'none'"


def test_what_is_refused_never_reaches_the_page() -> None:
    scope = {**http(), "headers": [(b"host", b"evil.example")]}
    sent, behind = ask(Access(), scope)
    assert behind == []
    assert sent[0]["status"] == 403
    assert b"none of its names" in sent[1]["body"]


def test_the_right_token_becomes_a_cookie_and_leaves_the_address() -> None:
    access = Access(token="right")
    sent, behind = ask(access, http("/", b"token=right&tab=sweep"))
    assert behind == []
    assert sent[0]["status"] == 303
    assert headers_of(sent)[b"location"] == b"/?tab=sweep"
    cookie = headers_of(sent)[b"set-cookie"].decode().lower()
    assert cookie.startswith("benchtool-1=right")
    assert "httponly" in cookie
    assert "samesite=strict" in cookie
    sent, behind = ask(access, http("/", b"", (b"cookie", b"benchtool-1=right")))
    assert (sent[0]["status"], behind) == (200, ["/"])


def test_a_wrong_token_gets_nothing_not_even_files() -> None:
    access = Access(token="right")
    for path in ("/", "/static/page.css", "/_nicegui_ws/socket.io/"):
        for query, cookie in ((b"token=wrong", b""), (b"", b"benchtool-1=wrong"), (b"", b"\xff")):
            sent, behind = ask(access, http(path, query, (b"cookie", cookie)))
            assert (sent[0]["status"], behind) == (403, [])


def test_a_socket_of_another_page_is_closed_before_it_opens() -> None:
    scope = {
        "type": "websocket",
        "path": "/control",
        "query_string": b"",
        "headers": [HOST, (b"origin", b"http://evil.example")],
    }
    sent, behind = ask(Access(), scope)
    assert behind == []
    assert sent == [{"type": "websocket.close", "code": 1008}]
    scope["headers"] = [HOST, (b"origin", b"http://127.0.0.1:8460")]
    sent, behind = ask(Access(), scope)
    assert sent == [{"type": "websocket.accept"}]


def test_start_and_end_of_the_server_pass() -> None:
    assert ask(Access(), {"type": "lifespan"}) == ([], ["lifespan"])
