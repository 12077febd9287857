"""`benchtool runs`: close runs whose program ended before it could."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from benchtool.commands.declared import declared
from benchtool.core.inputs import Input, Inputs


@dataclass(frozen=True, slots=True, kw_only=True)
class CloseInputs(Inputs):
    """What `benchtool runs close` takes."""

    runs: Annotated[tuple[Path, ...], Input("Run folders.", argument="RUN")]


def close(inputs: CloseInputs) -> None:
    """Mend what a killed program left of runs and write their tables; safe to repeat."""
    from benchtool.acquire.resume import close_run
    from benchtool.data.run.run import Run

    for path in inputs.runs:
        run = Run.open(path)
        written = close_run(run)
        facts = run.metadata
        reason = f" ({facts['reason']})" if facts.get("reason") else ""
        done = "closed" if written else "it was closed already"
        print(f"{path}: {done}; {facts.get('state', '')}{reason}")


command = declared(CloseInputs, close)
