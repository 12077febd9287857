"""Web application. `serve` imports this module last, as the web framework is slow to import."""

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
from benchtool.web.bench_process.publisher import merge_frames
from benchtool.web.bench_process.spawn import ProcessHandle
from benchtool.web.context import ServerState
from benchtool.web.control_socket import serve_control_sockets
from benchtool.web.page import serve_page
from benchtool.web.theme import serve_static
from benchtool.web.widgets import notify_all_pages, notify_error

RECONNECT_TIMEOUT_S = 15.0  # a page disconnected for longer is dropped; assumed
MAX_MESSAGE_BYTES = 1_000_000  # of a websocket; files are uploaded by requests


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
    serve_control_sockets(server)
    serve_stream(server.bench)
    serve_page(server)
    # NiceGUI behaves differently if this is set.
    os.environ.pop("PYTEST_CURRENT_TEST", None)
    guarded = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    guarded.add_middleware(
        AccessMiddleware, access=access, cookie=f"benchtool-{port}",
        stop_port=process.stop_endpoint.port if process.stop_endpoint else None,
    )  # fmt: skip
    # Quasar's loading bar has no accessible name and is in no landmark.
    app.config.quasar_config["loadingBar"]["skipHijack"] = True
    ui.run_with(
        guarded, title="benchtool", show_welcome_message=False,
        reconnect_timeout=RECONNECT_TIMEOUT_S, language="en-US", tailwind=False,
        # On the loopback interface, compression costs more time than it saves.
        gzip_middleware_factory=None if access.token is None else GZipMiddleware,
    )  # fmt: skip
    config = uvicorn.Config(
        guarded, log_level="warning", ws="wsproto", ws_max_size=MAX_MESSAGE_BYTES
    )
    uvicorn.Server(config).run(sockets=[listening])


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
            while True:  # a page sends nothing; this raises on disconnection
                await socket.receive_bytes()
        except (WebSocketDisconnect, RuntimeError, KeyError):
            pass
        finally:
            sending.cancel()
            buffers.discard(buffer)
