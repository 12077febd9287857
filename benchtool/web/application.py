"""The page's application. Heavy to import, by the web framework; `serve` does that last."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

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


def run_application(
    runs: Path,
    place: tuple[str, int],
    access: Access,
    process: BenchProcess,
    announce: Callable[[], None],
) -> None:
    """Serve the page until Ctrl-C.

    Args:
        runs: folder of runs, the only one that the page reads and writes.
        place: address and port to bind to.
        access: who may ask.
        process: of the bench, started.
        announce: is called once the page can be opened.
    """
    host, port = place
    shared = Shared(runs=runs, bench=BenchLink(process))
    app.add_middleware(Doorman, access=access, cookie=f"benchtool-{port}")
    stream = Stream()
    shared.bench.framed = stream.show
    shared.bench.said = say_everywhere
    app.on_startup(shared.bench.start)
    app.on_startup(announce)
    app.on_shutdown(shared.close)
    app.on_exception(say_error)
    serve_static()
    serve_control_line(shared)
    stream.serve()
    serve_page(shared)
    # A name that a browser may ask for is settled by us, not by the environment of a test.
    os.environ.pop("PYTEST_CURRENT_TEST", None)
    ui.run(
        host=host, port=port, title="benchtool", reload=False, show=False,
        show_welcome_message=False, reconnect_timeout=RECONNECT_S, language=None, tailwind=False,
        # Without a network between, packing costs more than it saves.
        gzip_middleware_factory=None if access.token is None else GZipMiddleware,
    )  # fmt: skip
