"""The websocket that carries Stop and the hand on the throttle, and nothing else."""

from __future__ import annotations

import re
from time import monotonic
from typing import ClassVar

from fastapi import WebSocket, WebSocketDisconnect
from nicegui import app
from nicegui.element import Element

from benchtool.web.context import Context, Shared
from benchtool.web.desk.asks import Hold, Release
from benchtool.web.theme import STATIC

LONGEST_NAME = 64

_HOLD = re.compile(r"hold (\d{1,9}) (\d{1,5}(?:\.\d{1,3})?) (\d{1,2}(?:,\d{1,2}){0,15})")


class ControlLine(Element, component=STATIC / "control_line.js"):
    """Hold the page's end: Stop buttons, space bar and Escape, the button that is held.

    Args:
        context: learns the name of the browser's tab, and whether the page is dark.
    """

    pages: ClassVar[dict[str, Context]] = {}
    """Pages by the name of their connection."""

    def __init__(self, context: Context) -> None:
        super().__init__()
        page = self.client.id
        self._props["page"] = page
        self.pages[page] = context
        self.on("dark", lambda told: setattr(context, "dark", bool(told.args)))
        context.let_go = self.let_go
        self.client.on_delete(lambda: self.pages.pop(page, None))

    def let_go(self) -> None:
        """Let the page's button go, when a press of it has ended elsewhere."""
        self.run_method("release")


def hear(shared: Shared, tab: str, word: str) -> None:
    """Hand on what the hand on the throttle says: `hold PRESS PULSE ROTORS` or `release`.

    Anything else is left unheard, and a hand that is not heard has let go.
    """
    if word == "release":
        shared.bench.ask(Release())
        return
    match = _HOLD.fullmatch(word)
    if match is not None:
        rotors = tuple(int(number) for number in match[3].split(","))
        shared.bench.ask(Hold(f"{tab} {match[1]}", float(match[2]), rotors))


def serve_control_line(shared: Shared) -> None:
    """Take control lines under /control."""

    @app.websocket("/control")
    async def control(socket: WebSocket, page: str, tab: str) -> None:
        await socket.accept()
        tab = tab[:LONGEST_NAME]
        shared.seat.arrive(tab)
        if (context := ControlLine.pages.get(page)) is not None:
            context.tab = tab
            context.arrived()
        try:
            while True:
                word = await socket.receive_text()
                if word == "stop":
                    shared.bench.stop("the page")
                    await socket.send_text("stopped")
                elif shared.seat.controls(tab):
                    hear(shared, tab, word)
        except WebSocketDisconnect:
            pass
        finally:
            if shared.seat.controls(tab):
                shared.bench.ask(Release())
            shared.seat.leave(tab, monotonic())

    @app.post("/stop")
    def stop() -> str:
        """Stop when the control line is down."""
        shared.bench.stop("the page")
        return "stopped"
