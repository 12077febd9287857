"""`benchtool simulate`: what would happen, in closed loop. One subcommand per module."""

from __future__ import annotations

from importlib import import_module

import typer

SUBCOMMANDS = ("pitch", "flight", "paper")
"""Names of the subcommands; each is a module `simulate_<name>` with a function `command`."""

app = typer.Typer(no_args_is_help=True, rich_markup_mode=None, add_completion=False)

for _name in SUBCOMMANDS:
    app.command(_name)(import_module(f"benchtool.commands.simulate_{_name}").command)


@app.callback()
def _group() -> None:
    """Simulate benches and flights near surfaces in closed loop."""
