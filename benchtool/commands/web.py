"""`benchtool web`: the page."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Annotated

import typer

PAGE = "benchtool.web.serve"
"""Named, not imported: the page stands above the commands."""


def command(
    runs: Annotated[
        Path, typer.Option(help="Folder of runs; the page reads and writes no other.")
    ] = Path("runs"),
    host: Annotated[
        str, typer.Option(help="Address to serve on; others than this machine need the token.")
    ] = "127.0.0.1",
    port: Annotated[
        int | None, typer.Option(min=0, max=65535, help="Port; 8460 or a free one without.")
    ] = None,
    token: Annotated[
        bool, typer.Option("--token", help="Want the token on this machine, too.")
    ] = False,
    browser: Annotated[bool, typer.Option(help="Open the page in a browser.")] = True,
) -> None:
    """Serve a page to watch, sweep, fit and explain in a browser."""
    page = import_module(PAGE)
    opened: list[Path | None] = []

    def announce(address: str) -> None:
        print(address, flush=True)
        if browser:
            opened.append(page.open_page(address))

    try:
        page.serve(runs, host, port, announce, wants_token=token)
    finally:
        for file in opened:
            if file is not None:
                file.unlink(missing_ok=True)
