from __future__ import annotations

import asyncio
from typing import Any

from benchtool.web.access import (
    MAX_BODY_BYTES,
    MAX_WAITING,
    WRONG_TOKEN_DELAY_S,
    Access,
    AccessMiddleware,
)

HOST = (b"host", b"127.0.0.1:8460")


async def slept(seconds: float) -> None:
    """Return at once (no-op)."""


def ask(
    access: Access, scope: dict[str, Any], stop_port: int | None = None
) -> tuple[list[dict[str, Any]], list[str]]:
    """Return the messages sent for a request, and the paths that reached the application."""
    sent: list[dict[str, Any]] = []
    forwarded: list[str] = []

    async def app(scope: Any, receive: Any, send: Any) -> None:
        forwarded.append(scope.get("path", scope["type"]))
        if scope["type"] == "http":
            await send({"type": "http.response.start", "status": 200, "headers": []})
            await send({"type": "http.response.body", "body": b"page"})
        elif scope["type"] == "websocket":
            await send({"type": "websocket.accept"})

    async def receive() -> dict[str, Any]:
        return {"type": "websocket.connect"}

    async def send(message: Any) -> None:
        sent.append(message)

    asyncio.run(
        AccessMiddleware(app, access, "benchtool-1", slept, stop_port)(scope, receive, send)
    )
    return sent, forwarded


def http(path: str = "/", query: bytes = b"", *headers: tuple[bytes, bytes]) -> dict[str, Any]:
    return {
        "type": "http",
        "method": "GET",
        "path": path,
        "query_string": query,
        "headers": [HOST, *headers],
    }


def sent_headers(sent: list[dict[str, Any]]) -> dict[bytes, bytes]:
    return dict(sent[0]["headers"])


def test_the_page_may_reach_the_port_of_stop_alone_beside_its_own():
    sent, _ = ask(Access(), http(), stop_port=9001)
    policy = sent_headers(sent)[b"content-security-policy"].decode()
    assert "wss://127.0.0.1:8460 http://127.0.0.1:9001;" in policy


def test_what_is_let_in_cannot_be_framed():
    sent, forwarded = ask(Access(), http())
    assert forwarded == ["/"]
    assert sent[0]["status"] == 200
    assert sent_headers(sent)[b"x-frame-options"] == b"DENY"
    policy = sent_headers(sent)[b"content-security-policy"].decode()
    assert "frame-ancestors 'none'" in policy
    assert "default-src 'none'" in policy
    assert "connect-src 'self' ws://127.0.0.1:8460 wss://127.0.0.1:8460;" in policy
    assert "http" not in policy


def test_what_is_refused_never_reaches_the_page():
    scope = {**http(), "headers": [(b"host", b"evil.example")]}
    sent, forwarded = ask(Access(), scope)
    assert forwarded == []
    assert sent[0]["status"] == 403
    assert b"is not a name of this server" in sent[1]["body"]


def test_the_right_token_becomes_a_cookie_and_leaves_the_address():
    access = Access(token="right")
    sent, forwarded = ask(access, http("/", b"token=right&tab=sweep"))
    assert forwarded == []
    assert sent[0]["status"] == 200
    assert b"url=/?tab=sweep" in sent[1]["body"]
    cookie = sent_headers(sent)[b"set-cookie"].decode().lower()
    assert cookie.startswith("benchtool-1=right")
    assert "httponly" in cookie
    assert "samesite=strict" in cookie
    sent, forwarded = ask(access, http("/", b"", (b"cookie", b"benchtool-1=right")))
    assert (sent[0]["status"], forwarded) == (200, ["/"])


def test_a_wrong_token_gets_nothing_not_even_files():
    access = Access(token="right")
    for path in ("/", "/static/page.css", "/_nicegui_ws/socket.io/"):
        for query, cookie in ((b"token=wrong", b""), (b"", b"benchtool-1=wrong"), (b"", b"\xff")):
            sent, forwarded = ask(access, http(path, query, (b"cookie", cookie)))
            assert (sent[0]["status"], forwarded) == (403, [])


def test_a_socket_of_another_page_is_closed_before_it_opens():
    scope = {
        "type": "websocket",
        "path": "/control",
        "query_string": b"",
        "headers": [HOST, (b"origin", b"http://evil.example")],
    }
    sent, forwarded = ask(Access(), scope)
    assert forwarded == []
    assert sent == [{"type": "websocket.close", "code": 1008}]
    scope["headers"] = [HOST, (b"origin", b"http://127.0.0.1:8460")]
    sent, forwarded = ask(Access(), scope)
    assert sent == [{"type": "websocket.accept"}]


def test_start_and_end_of_the_server_pass():
    assert ask(Access(), {"type": "lifespan"}) == ([], ["lifespan"])


def test_wrong_tokens_wait_for_each_other_and_the_right_one_for_nobody():
    responses: list[tuple[int, float]] = []
    clock_s = 0.0

    async def app(scope: Any, receive: Any, send: Any) -> None:
        await send({"type": "http.response.start", "status": 200, "headers": []})

    async def sleep(seconds: float) -> None:
        nonlocal clock_s
        await asyncio.sleep(0)
        clock_s += seconds

    async def receive() -> dict[str, Any]:
        return {"type": "http.request"}

    async def send(message: Any) -> None:
        if message["type"] == "http.response.start":
            responses.append((message["status"], clock_s))

    async def guess() -> None:
        guarded = AccessMiddleware(app, Access(token="right"), "benchtool-1", sleep)
        wrong = [
            guarded(http("/", b"", (b"cookie", b"benchtool-1=guess%d" % i)), receive, send)
            for i in range(MAX_WAITING + 5)
        ]
        right = guarded(http("/", b"", (b"cookie", b"benchtool-1=right")), receive, send)
        await asyncio.gather(*wrong, right)

    asyncio.run(guess())
    assert [time_s for status, time_s in responses if status == 200] == [0.0]
    assert [time_s for status, time_s in responses if status == 429] == 5 * [0.0]
    delayed = [time_s for status, time_s in responses if status == 403]
    assert delayed == [WRONG_TOKEN_DELAY_S * (i + 1) for i in range(MAX_WAITING)]


def test_a_body_is_refused_while_it_arrives():
    part = b"x" * 1_000_000
    received, sent = 0, []

    async def app(scope: Any, receive: Any, send: Any) -> None:
        try:
            while (await receive()).get("more_body"):
                pass
        except Exception as error:  # as web frameworks
            await send({"type": "http.response.start", "status": 500, "headers": []})
            raise error

    async def receive() -> dict[str, Any]:
        nonlocal received
        received += len(part)
        return {"type": "http.request", "body": part, "more_body": True}

    async def send(message: Any) -> None:
        sent.append(message)

    scope = {**http(), "method": "POST"}
    scope["headers"] = [HOST, (b"sec-fetch-site", b"same-origin")]
    asyncio.run(AccessMiddleware(app, Access(), "benchtool-1")(scope, receive, send))
    assert [message.get("status") for message in sent] == [413, None]
    assert b"request is too large" in sent[1]["body"]
    assert received <= MAX_BODY_BYTES + len(part)
