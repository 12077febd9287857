"""The page's application. Heavy to import, by the web framework; `serve` does that last."""

from __future__ import annotations

import asyncio
import os
import socket
from contextlib import suppress
from pathlib import Path

import uvicorn
from fastapi import FastAPI, WebSocket, WebSocketDisconnect
from fastapi.middleware.gzip import GZipMiddleware
from nicegui import app, ui

from benchtool.web.access import Access
from benchtool.web.access_middleware import AccessMiddleware
from benchtool.web.bench_process.client import BenchClient
from benchtool.web.bench_process.messages import Notice
from benchtool.web.bench_process.publisher import merged
from benchtool.web.bench_process.spawn import ProcessHandle
from benchtool.web.context import ServerState
from benchtool.web.control_socket import serve_control_line
from benchtool.web.page import serve_page
from benchtool.web.theme import serve_static
from benchtool.web.widgets import notify_all_pages, notify_error

RECONNECT_S = 15.0  # a page silent for longer is dropped; assumed
MAX_MESSAGE_BYTES = 1_000_000  # of a websocket; files come as requests


def run_application(
    runs: Path, listening: socket.socket, access: Access, process: ProcessHandle
) -> None:
    """Serve the page until Ctrl-C."""
    port = listening.getsockname()[1]
    server = ServerState(runs=runs, bench=BenchClient(process), stop_endpoint=process.stop_endpoint)

    def show_notice(notice: Notice) -> None:
        server.log.add(notice.text, is_error=notice.is_error)
        notify_all_pages(notice)

    server.bench.on_notice = show_notice
    server.bench.on_alarm = lambda text: server.log.add(text, is_error=True)
    app.on_startup(server.bench.start)
    app.on_shutdown(server.close)
    app.on_exception(notify_error)
    serve_static()
    serve_control_line(server)
    serve_stream(server.bench)
    serve_page(server)
    # NiceGUI answers differently under pytest; here the server decides.
    os.environ.pop("PYTEST_CURRENT_TEST", None)
    guarded = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    guarded.add_middleware(
        AccessMiddleware, access=access, cookie=f"benchtool-{port}",
        stop_port=process.stop_endpoint.port if process.stop_endpoint else None,
    )  # fmt: skip
    # Quasar's bar at every request has no name for a screen reader and stands in no landmark.
    app.config.quasar_config["loadingBar"]["skipHijack"] = True
    ui.run_with(
        guarded, title="benchtool", show_welcome_message=False,
        reconnect_timeout=RECONNECT_S, language="en-US", tailwind=False,
        # Without a network between, packing costs more than it saves.
        gzip_middleware_factory=None if access.token is None else GZipMiddleware,
    )  # fmt: skip
    config = uvicorn.Config(
        guarded, log_level="warning", ws="wsproto", ws_max_size=MAX_MESSAGE_BYTES
    )
    uvicorn.Server(config).run(sockets=[listening])


class FrameBuffer:
    """Hold what one page has not been sent yet: frames that wait become one, none is lost."""

    def __init__(self) -> None:
        self._waiting: bytes | None = None
        self._ready = asyncio.Event()

    def put(self, frame: bytes) -> None:
        self._waiting = frame if self._waiting is None else merged(self._waiting, frame)
        self._ready.set()

    async def send_all(self, socket: WebSocket) -> None:
        with suppress(WebSocketDisconnect, RuntimeError):
            while True:
                await self._ready.wait()
                self._ready.clear()
                frame, self._waiting = self._waiting, None
                assert frame is not None
                await socket.send_bytes(frame)


def serve_stream(bench: BenchClient) -> None:
    """Give every page under /stream every frame of the live stream."""
    viewers: set[FrameBuffer] = set()

    def publish(frame: bytes) -> None:
        for viewer in viewers:
            viewer.put(frame)

    bench.on_frame = publish

    @app.websocket("/stream")
    async def stream(socket: WebSocket) -> None:
        await socket.accept()
        viewer = FrameBuffer()
        viewers.add(viewer)
        sending = asyncio.ensure_future(viewer.send_all(socket))
        try:
            while True:  # a page sends nothing: what comes is its end
                await socket.receive_bytes()
        except (WebSocketDisconnect, RuntimeError, KeyError):
            pass
        finally:
            sending.cancel()
            viewers.discard(viewer)
