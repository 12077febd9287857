"""The websockets that carry Stop and the reports of the throttle button, and nothing else."""

from __future__ import annotations

import re
from contextlib import suppress
from time import monotonic

from fastapi import WebSocket, WebSocketDisconnect
from nicegui import app, background_tasks, ui

from benchtool.web.bench_process.messages import HoldThrottle, PressEnded, ReleaseThrottle
from benchtool.web.bench_process.throttle import RELEASE_TIMEOUT_S
from benchtool.web.context import PageContext, ServerState

MAX_NAME_LENGTH = 64

_HOLD = re.compile(r"hold (\d{1,15}) (\d{1,5}) (\d{1,2}(?:,\d{1,2}){0,15}) (\d{1,6})")
_RELEASE = re.compile(r"release (\d{1,15})")
_BEAT = re.compile(r"beat (\d{1,9})")


PAGES: dict[str, PageContext] = {}  # Pages by the name of their connection


def add_control_line(context: PageContext) -> None:
    """Give the present page its end: Stop buttons, space bar and Escape, the button that is held.

    Called before anything else of the page is made: the script's listeners must be the first.
    """
    client = ui.context.client
    PAGES[client.id] = context
    client.on_delete(lambda: PAGES.pop(client.id, None))
    facts = f'data-page="{client.id}" data-silence-ms="{1e3 * RELEASE_TIMEOUT_S:.0f}"'
    if (stop := context.server.stop_endpoint) is not None:
        facts += f' data-stop-port="{stop.port}" data-stop-token="{stop.token}"'
    ui.add_head_html(f'<script src="/static/stop.js" {facts}></script>')


def forward(server: ServerState, tab: str, word: str) -> None:
    """Forward a report of the throttle button to the bench process.

    Known are `hold PRESS PULSE ROTORS AGE_MS` and `release PRESS`. Anything else is ignored, and a
    button without reports counts as released.
    """
    if (match := _RELEASE.fullmatch(word)) is not None:
        server.bench.send(ReleaseThrottle(tab, int(match[1])))
    elif (match := _HOLD.fullmatch(word)) is not None:
        rotors = tuple(int(number) for number in match[3].split(","))
        server.bench.send(
            HoldThrottle(tab, int(match[1]), float(match[2]), rotors, 1e-3 * float(match[4]))
        )


async def _send(socket: WebSocket, word: str) -> None:
    """Send a word; that the page has gone meanwhile is noticed by its handler."""
    with suppress(WebSocketDisconnect, RuntimeError):
        await socket.send_text(word)


def serve_control_line(server: ServerState) -> None:
    """Take control lines under /control."""
    lines: set[tuple[str, WebSocket]] = set()

    def press_ended(ended: PressEnded) -> None:
        for tab, socket in lines:
            if tab == ended.tab:
                background_tasks.create(_send(socket, f"let go {ended.reason}"))

    server.bench.on_press_ended = press_ended

    @app.websocket("/control")
    async def control(socket: WebSocket, page: str, tab: str) -> None:
        await socket.accept()
        tab = tab[:MAX_NAME_LENGTH]
        server.control.arrive(tab)
        lines.add((tab, socket))
        if (context := PAGES.get(page)) is not None:
            context.arrive(tab)
        try:
            while True:
                word = await socket.receive_text()
                if word == "stop":
                    server.bench.stop("the page")
                    await socket.send_text("stopped")
                elif word == "ping":
                    await socket.send_text("pong")
                elif word in ("dark 0", "dark 1") and context is not None:
                    context.dark = word == "dark 1"
                elif server.control.held_by(tab):
                    forward(server, tab, word)
        except WebSocketDisconnect:
            pass
        finally:
            lines.discard((tab, socket))
            server.control.leave(tab, monotonic())

    @app.websocket("/hold")
    async def hold(socket: WebSocket, tab: str) -> None:
        await socket.accept()
        tab = tab[:MAX_NAME_LENGTH]
        with suppress(WebSocketDisconnect):
            while True:
                word = await socket.receive_text()
                if (match := _BEAT.fullmatch(word)) is not None:
                    server.watch.beat(tab, 1e-3 * float(match[1]), monotonic())
                elif server.control.held_by(tab):
                    forward(server, tab, word)
        server.watch.leave(tab)
        server.bench.send(ReleaseThrottle(tab))

    @app.post("/stop")
    def stop() -> str:
        server.bench.stop("the page")
        return "stopped"
