"""Frames of the live stream, from the bench process to every page that looks."""

from __future__ import annotations

import asyncio

from fastapi import WebSocket, WebSocketDisconnect
from nicegui import app

from benchtool.web.bench_process.frame import merged


class FrameViewer:
    """Hold what one page has not been sent yet: frames that wait become one, none is lost."""

    def __init__(self) -> None:
        self._waiting: bytes | None = None
        self._ready = asyncio.Event()

    def put(self, frame: bytes) -> None:
        """Take a frame."""
        self._waiting = frame if self._waiting is None else merged(self._waiting, frame)
        self._ready.set()

    async def next(self) -> bytes:
        """Return the next frame once there is one."""
        await self._ready.wait()
        self._ready.clear()
        frame, self._waiting = self._waiting, None
        assert frame is not None
        return frame


class FrameStream:
    """Give every viewer every frame."""

    def __init__(self) -> None:
        self._viewers: set[FrameViewer] = set()

    def publish(self, frame: bytes) -> None:
        """Take a frame from the bench process."""
        for viewer in self._viewers:
            viewer.put(frame)

    def serve(self) -> None:
        """Take viewers under /stream."""

        @app.websocket("/stream")
        async def stream(socket: WebSocket) -> None:
            await socket.accept()
            viewer = FrameViewer()
            self._viewers.add(viewer)
            gone = asyncio.ensure_future(_until_gone(socket))
            try:
                while True:
                    frame = asyncio.ensure_future(viewer.next())
                    done, _ = await asyncio.wait({gone, frame}, return_when=asyncio.FIRST_COMPLETED)
                    if gone in done:
                        frame.cancel()
                        return
                    await socket.send_bytes(frame.result())
            except (WebSocketDisconnect, RuntimeError):
                pass
            finally:
                gone.cancel()
                self._viewers.discard(viewer)


async def _until_gone(socket: WebSocket) -> None:
    """Wait until a page that sends nothing has gone."""
    try:
        while True:
            await socket.receive_bytes()
    except (WebSocketDisconnect, RuntimeError, KeyError):
        return
