"""Command `benchtool web`: browser interface."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Annotated

from annotated_types import Ge, Le

from benchtool.commands.input_commands import command_from_inputs
from benchtool.core.inputs import Input, Inputs

SERVE_MODULE = "benchtool.web.serve"  # imported on call: the web package imports commands


@dataclass(frozen=True, slots=True, kw_only=True)
class WebInputs(Inputs):
    """Options of `benchtool web`."""

    runs: Annotated[Path, Input("Folder of runs; the only one that the page accesses.")] = Path(
        "runs"
    )
    host: Annotated[str, Input("Address to listen on; other machines need the token.")] = (
        "127.0.0.1"
    )
    port: Annotated[
        Annotated[int, Ge(0), Le(65535)] | None, Input("Port.", default_text="8460 or a free one")
    ] = None
    token: Annotated[bool, Input("Require the token on this machine, too.")] = False
    browser: Annotated[bool, Input("Open the page in a browser.")] = True


@command_from_inputs(WebInputs)
def web(inputs: WebInputs) -> None:
    """Start the browser interface."""
    server = import_module(SERVE_MODULE)
    redirect_files: list[Path | None] = []

    def announce(address: str) -> None:
        print(address, flush=True)
        if inputs.browser:
            redirect_files.append(server.open_page(address))

    try:
        server.serve(inputs.runs, inputs.host, inputs.port, announce, requires_token=inputs.token)
    finally:
        for file in redirect_files:
            if file is not None:
                file.unlink(missing_ok=True)
