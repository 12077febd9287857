"""Websockets for STOP, heartbeats, reports of the throttle button and the live stream."""

from __future__ import annotations

import asyncio
import re
from contextlib import suppress
from time import monotonic

from fastapi import WebSocket, WebSocketDisconnect
from nicegui import app, background_tasks, ui

from benchtool.web.bench_process import messages
from benchtool.web.bench_process.client import BenchClient
from benchtool.web.bench_process.publisher import merge_frames
from benchtool.web.bench_process.throttle import RELEASE_TIMEOUT_S
from benchtool.web.context import PageContext, ServerState

MAX_NAME_LENGTH = 64
_HOLD = re.compile(r"hold (\d{1,15}) (\d{1,5}) (\d{1,2}(?:,\d{1,2}){0,15}) (\d{1,6})")
_RELEASE = re.compile(r"release (\d{1,15})")
_HEARTBEAT = re.compile(r"beat (\d{1,9})")
PAGES: dict[str, PageContext] = {}  # by client id


def add_control_script(context: PageContext) -> None:
    """Add the script for STOP, space bar, Escape and the throttle button to the current page.

    Must be called before other elements are created: its listeners must be the first.
    """
    client = ui.context.client
    PAGES[client.id] = context
    client.on_delete(lambda: PAGES.pop(client.id, None))
    data = f'data-page="{client.id}" data-silence-ms="{1e3 * RELEASE_TIMEOUT_S:.0f}"'
    if (stop := context.server.stop_endpoint) is not None:
        data += f' data-stop-port="{stop.port}" data-stop-token="{stop.token}"'
    ui.add_head_html(f'<script src="/static/stop.js" {data}></script>')


def forward(server: ServerState, tab: str, message: str) -> None:
    """Forward a report of the throttle button to the bench process.

    Messages are `hold PRESS PULSE ROTORS AGE_MS` and `release PRESS`; others are ignored. A button
    without reports counts as released.
    """
    if (match := _RELEASE.fullmatch(message)) is not None:
        server.bench.send(messages.ReleaseThrottle(tab, int(match[1])))
    elif (match := _HOLD.fullmatch(message)) is not None:
        rotors = tuple(int(number) for number in match[3].split(","))
        server.bench.send(
            messages.HoldThrottle(
                tab, int(match[1]), float(match[2]), rotors, 1e-3 * float(match[4])
            )
        )


async def _send(socket: WebSocket, message: str) -> None:
    """Send a message; a disconnection is detected by the socket's handler."""
    with suppress(WebSocketDisconnect, RuntimeError):
        await socket.send_text(message)


def serve_control_sockets(server: ServerState) -> None:
    """Serve /control, /hold and /stop."""
    connections: set[tuple[str, WebSocket]] = set()

    def report_end(event: messages.PressEnded) -> None:
        for tab, socket in connections:
            if tab == event.tab:
                background_tasks.create(_send(socket, f"let go {event.reason}"))

    server.bench.on_press_ended = report_end

    @app.websocket("/control")
    async def control(socket: WebSocket, page: str, tab: str) -> None:
        await socket.accept()
        tab = tab[:MAX_NAME_LENGTH]
        server.control.connect(tab)
        connections.add((tab, socket))
        if (context := PAGES.get(page)) is not None:
            context.connect(tab)
        try:
            while True:
                message = await socket.receive_text()
                if message == "stop":
                    server.bench.send(messages.StopMotors())
                    await socket.send_text("stopped")
                elif message == "ping":
                    await socket.send_text("pong")
                elif message in ("dark 0", "dark 1") and context is not None:
                    context.dark = message == "dark 1"
                elif server.control.is_held_by(tab):
                    forward(server, tab, message)
        except WebSocketDisconnect:
            pass
        finally:
            connections.discard((tab, socket))
            server.control.disconnect(tab, monotonic())

    @app.websocket("/hold")
    async def hold(socket: WebSocket, tab: str) -> None:
        await socket.accept()
        tab = tab[:MAX_NAME_LENGTH]
        with suppress(WebSocketDisconnect):
            while True:
                message = await socket.receive_text()
                if (match := _HEARTBEAT.fullmatch(message)) is not None:
                    server.watch.record_heartbeat(tab, 1e-3 * float(match[1]), monotonic())
                elif server.control.is_held_by(tab):
                    forward(server, tab, message)
        server.watch.disconnect(tab)
        server.bench.send(messages.ReleaseThrottle(tab))

    @app.post("/stop")
    def stop() -> str:
        server.bench.send(messages.StopMotors())
        return "stopped"


class FrameBuffer:
    """Buffer of frames for one page; pending frames are merged, no extreme is lost."""

    def __init__(self) -> None:
        self._pending: bytes | None = None
        self._ready = asyncio.Event()

    def put(self, frame: bytes) -> None:
        self._pending = frame if self._pending is None else merge_frames(self._pending, frame)
        self._ready.set()

    async def send_all(self, socket: WebSocket) -> None:
        with suppress(WebSocketDisconnect, RuntimeError):
            while True:
                await self._ready.wait()
                self._ready.clear()
                frame, self._pending = self._pending, None
                assert frame is not None
                await socket.send_bytes(frame)


def serve_stream(bench: BenchClient) -> None:
    """Serve the frames of the live stream under /stream."""
    buffers: set[FrameBuffer] = set()

    def publish(frame: bytes) -> None:
        for buffer in buffers:
            buffer.put(frame)

    bench.on_frame = publish

    @app.websocket("/stream")
    async def stream(socket: WebSocket) -> None:
        await socket.accept()
        buffer = FrameBuffer()
        buffers.add(buffer)
        sending = asyncio.ensure_future(buffer.send_all(socket))
        try:
            with suppress(WebSocketDisconnect, RuntimeError, KeyError):
                while True:  # a page sends nothing; this raises on disconnection
                    await socket.receive_bytes()
        finally:
            sending.cancel()
            buffers.discard(buffer)
