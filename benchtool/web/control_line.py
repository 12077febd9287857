"""The websocket that carries Stop and the hand on the throttle, and nothing else."""

from __future__ import annotations

from time import monotonic
from typing import ClassVar

from fastapi import WebSocket, WebSocketDisconnect
from nicegui import app
from nicegui.element import Element

from benchtool.web.context import Context, Shared
from benchtool.web.theme import STATIC

LONGEST_NAME = 64


class ControlLine(Element, component=STATIC / "control_line.js"):
    """Hold the page's end: Stop buttons, space bar and Escape.

    Args:
        context: learns the name of the browser's tab.
    """

    pages: ClassVar[dict[str, Context]] = {}
    """Pages by the name of their connection."""

    def __init__(self, context: Context) -> None:
        super().__init__()
        page = self.client.id
        self._props["page"] = page
        self.pages[page] = context
        self.client.on_delete(lambda: self.pages.pop(page, None))


def serve_control_line(shared: Shared) -> None:
    """Take control lines under /control."""

    @app.websocket("/control")
    async def control(socket: WebSocket, page: str, tab: str) -> None:
        await socket.accept()
        tab = tab[:LONGEST_NAME]
        if (context := ControlLine.pages.get(page)) is not None:
            context.tab = tab
        shared.seat.arrive(tab)
        try:
            while True:
                word = await socket.receive_text()
                if word == "stop":
                    shared.bench.stop("the page")
                    await socket.send_text("stopped")
        except WebSocketDisconnect:
            pass
        finally:
            shared.seat.leave(tab, monotonic())

    @app.post("/stop")
    def stop() -> str:
        """Stop when the control line is down."""
        shared.bench.stop("the page")
        return "stopped"
