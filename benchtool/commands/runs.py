"""`benchtool runs`: close runs whose program ended before it could."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(help="Close runs whose program ended before it could.")


@app.callback()
def group() -> None:
    """Close runs whose program ended before it could."""


@app.command()
def close(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="Run folders.")],
) -> None:
    """Mend what a killed program left of runs and write their tables; safe to repeat."""
    from benchtool.acquire.resume import close_run
    from benchtool.data.run.run import Run

    for path in runs:
        run = Run.open(path)
        written = close_run(run)
        facts = run.metadata
        reason = f" ({facts['reason']})" if facts.get("reason") else ""
        done = "closed" if written else "it was closed already"
        print(f"{path}: {done}; {facts.get('state', '')}{reason}")
