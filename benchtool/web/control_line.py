"""The websocket that carries Stop and the hand on the throttle, and nothing else."""

from __future__ import annotations

import re
from contextlib import suppress
from time import monotonic

from fastapi import WebSocket, WebSocketDisconnect
from nicegui import app, background_tasks, ui

from benchtool.web.context import Context, Shared
from benchtool.web.desk.asks import Hold, Release
from benchtool.web.desk.hand import SILENCE_S
from benchtool.web.desk.news import PressEnded

LONGEST_NAME = 64

_HOLD = re.compile(r"hold (\d{1,15}) (\d{1,5}) (\d{1,2}(?:,\d{1,2}){0,15}) (\d{1,6})")
_RELEASE = re.compile(r"release (\d{1,15})")


PAGES: dict[str, Context] = {}
"""Pages by the name of their connection."""


def add_control_line(context: Context) -> None:
    """Give the present page its end: Stop buttons, space bar and Escape, the button that is held.

    Called before anything else of the page is made: the script's listeners must be the first.
    """
    client = ui.context.client
    PAGES[client.id] = context
    client.on_delete(lambda: PAGES.pop(client.id, None))
    facts = f'data-page="{client.id}" data-silence-ms="{1e3 * SILENCE_S:.0f}"'
    ui.add_head_html(f'<script src="/static/stop.js" {facts}></script>')


def hear(shared: Shared, tab: str, word: str) -> None:
    """Hand on what the hand on the throttle says.

    Known are `hold PRESS PULSE ROTORS AGE_MS` and `release PRESS`. Anything else is left unheard,
    and a hand that is not heard has let go.
    """
    if (match := _RELEASE.fullmatch(word)) is not None:
        shared.bench.ask(Release(tab, int(match[1])))
    elif (match := _HOLD.fullmatch(word)) is not None:
        rotors = tuple(int(number) for number in match[3].split(","))
        shared.bench.ask(Hold(tab, int(match[1]), float(match[2]), rotors, 1e-3 * float(match[4])))


async def _send(socket: WebSocket, word: str) -> None:
    """Send a word; a page that has gone meanwhile is noticed by its handler."""
    with suppress(WebSocketDisconnect, RuntimeError):
        await socket.send_text(word)


def serve_control_line(shared: Shared) -> None:
    """Take control lines under /control."""
    lines: set[tuple[str, WebSocket]] = set()

    def press_ended(ended: PressEnded) -> None:
        for tab, socket in lines:
            if tab == ended.tab:
                background_tasks.create(_send(socket, f"let go {ended.reason}"))

    shared.bench.press_ended = press_ended

    @app.websocket("/control")
    async def control(socket: WebSocket, page: str, tab: str) -> None:
        await socket.accept()
        tab = tab[:LONGEST_NAME]
        shared.seat.arrive(tab)
        lines.add((tab, socket))
        if (context := PAGES.get(page)) is not None:
            context.tab = tab
            context.arrived()
        try:
            while True:
                word = await socket.receive_text()
                if word == "stop":
                    shared.bench.stop("the page")
                    await socket.send_text("stopped")
                elif word == "ping":
                    await socket.send_text("pong")
                elif word in ("dark 0", "dark 1") and context is not None:
                    context.dark = word == "dark 1"
                elif shared.seat.controls(tab):
                    hear(shared, tab, word)
        except WebSocketDisconnect:
            pass
        finally:
            lines.discard((tab, socket))
            shared.seat.leave(tab, monotonic())

    @app.websocket("/hold")
    async def hold(socket: WebSocket, tab: str) -> None:
        """Take the beats of the page's worker."""
        await socket.accept()
        tab = tab[:LONGEST_NAME]
        with suppress(WebSocketDisconnect):
            while True:
                word = await socket.receive_text()
                if shared.seat.controls(tab):
                    hear(shared, tab, word)
        shared.bench.ask(Release(tab))

    @app.post("/stop")
    def stop() -> str:
        """Stop when the control line is down."""
        shared.bench.stop("the page")
        return "stopped"
