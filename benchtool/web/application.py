"""The page's application. Heavy to import, by the web framework; `serve` does that last."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import uvicorn
from fastapi import FastAPI
from fastapi.middleware.gzip import GZipMiddleware
from nicegui import app, ui

from benchtool.web.access import Access
from benchtool.web.bench_link import BenchLink
from benchtool.web.bench_process import BenchProcess
from benchtool.web.context import Shared
from benchtool.web.control_line import serve_control_line
from benchtool.web.doorman import Doorman
from benchtool.web.page import serve_page
from benchtool.web.stream import Stream
from benchtool.web.tell import say_error, say_everywhere
from benchtool.web.theme import serve_static

RECONNECT_S = 15.0
"""A page that was silent for so long is forgotten; loaded again, it starts anew. A choice: busy
machines make browsers wait for seconds."""

MOST_MESSAGE_BYTES = 1_000_000
"""What a page sends in one message over a websocket; files come as requests."""


def run_application(
    runs: Path, listening: socket.socket, access: Access, process: BenchProcess
) -> None:
    """Serve the page until Ctrl-C.

    Args:
        runs: folder of runs, the only one that the page reads and writes.
        listening: where browsers may be waiting already.
        access: who may ask.
        process: of the bench, started.
    """
    port = listening.getsockname()[1]
    shared = Shared(runs=runs, bench=BenchLink(process))
    stream = Stream()
    shared.bench.framed = stream.show
    shared.bench.said = say_everywhere
    app.on_startup(shared.bench.start)
    app.on_shutdown(shared.close)
    app.on_exception(say_error)
    serve_static()
    serve_control_line(shared)
    stream.serve()
    serve_page(shared)
    # A name that a browser may ask for is settled by us, not by the environment of a test.
    os.environ.pop("PYTEST_CURRENT_TEST", None)
    guarded = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    guarded.add_middleware(Doorman, access=access, cookie=f"benchtool-{port}")
    ui.run_with(
        guarded, title="benchtool", show_welcome_message=False,
        reconnect_timeout=RECONNECT_S, language=None, tailwind=False,
        # Without a network between, packing costs more than it saves.
        gzip_middleware_factory=None if access.token is None else GZipMiddleware,
    )  # fmt: skip
    config = uvicorn.Config(
        guarded, log_level="warning", ws="wsproto", ws_max_size=MOST_MESSAGE_BYTES
    )
    uvicorn.Server(config).run(sockets=[listening])
