"""`benchtool bench`: a virtual bench as a process of its own."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from benchtool.cli.check import check

app = typer.Typer(help="Serve a virtual bench; check a bench before motors spin.")


@app.callback()
def group() -> None:
    """Serve a virtual bench; check a bench before motors spin."""


app.command()(check)


@app.command()
def serve(
    rig: Annotated[str, typer.Option(help="Rig by name, or a rig file.")] = "pquad",
    truth: Annotated[
        str | None, typer.Option(help="Model whose thrust the load cell shows; by name or file.")
    ] = None,
    link: Annotated[str, typer.Option(help="pty, tcp:PORT or tcp:HOST:PORT.")] = "pty",
    symlink: Annotated[
        Path | None, typer.Option(help="A path that always leads to the pseudo-terminal.")
    ] = None,
    speed: Annotated[float, typer.Option(help="Device seconds per wall second.")] = 1.0,
    rate: Annotated[float, typer.Option(help="Samples per device second, Hz.")] = 200.0,
    seed: Annotated[int, typer.Option(min=0, help="Seed of noise and faults.")] = 0,
    fault: Annotated[
        list[str] | None, typer.Option(help="A fault, as silence:at_s=12,for_s=1; repeatable.")
    ] = None,
) -> None:
    """Run a virtual bench on a pseudo-terminal or TCP port until Ctrl-C."""
    import signal
    import sys

    from benchtool.bench.faults import fault_from
    from benchtool.bench.server_links import link_named
    from benchtool.bench.virtual_server import standard_truth, virtual_server
    from benchtool.core.toml_text import build
    from benchtool.library import load_model, rig_named
    from benchtool.simulate.imperfections import Imperfections

    faults = [fault_from(text) for text in fault or ()]
    stands = rig_named(rig)
    name = truth or standard_truth(stands)
    loaded = load_model(name, stands)
    flaws = build(Imperfections, dict(loaded.imperfections), f"{name}: [imperfections]")
    where = link_named(link, symlink)
    # A service manager's end, and Ctrl-Break of a Windows console, close the link like Ctrl-C.
    for name in ("SIGTERM", "SIGBREAK"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.default_int_handler)
    try:
        server = virtual_server(
            stands,
            loaded.model,
            where,
            seed=seed,
            speed=speed,
            rate_Hz=rate,
            imperfections=flaws,
            faults=faults,
        )
        print(where.address, flush=True)
        print(
            f"virtual bench of {stands.name}, truth {loaded.model.name}, speed {speed:g}; "
            f"no motor turns; Ctrl-C ends it",
            file=sys.stderr,
        )
        server.run()
    except KeyboardInterrupt:
        pass
    finally:
        where.close()
