"""`benchtool web`: the page."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Annotated

from annotated_types import Ge, Le

from benchtool.commands.input_commands import command_from_inputs
from benchtool.core.inputs import Input, Inputs

PAGE = "benchtool.web.serve"  # named, not imported: the page stands above the commands


@dataclass(frozen=True, slots=True, kw_only=True)
class WebInputs(Inputs):
    """What `benchtool web` takes."""

    runs: Annotated[Path, Input("Folder of runs; the page reads and writes no other.")] = Path(
        "runs"
    )
    host: Annotated[str, Input("Address to serve on; others than this machine need the token.")] = (
        "127.0.0.1"
    )
    port: Annotated[
        Annotated[int, Ge(0), Le(65535)] | None, Input("Port.", default_text="8460 or a free one")
    ] = None
    token: Annotated[bool, Input("Want the token on this machine, too.")] = False
    browser: Annotated[bool, Input("Open the page in a browser.")] = True


@command_from_inputs(WebInputs)
def web(inputs: WebInputs) -> None:
    """Start the browser interface."""
    page = import_module(PAGE)
    opened: list[Path | None] = []

    def announce(address: str) -> None:
        print(address, flush=True)
        if inputs.browser:
            opened.append(page.open_page(address))

    try:
        page.serve(inputs.runs, inputs.host, inputs.port, announce, wants_token=inputs.token)
    finally:
        for file in opened:
            if file is not None:
                file.unlink(missing_ok=True)
