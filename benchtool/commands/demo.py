"""`benchtool demo`: the whole story on virtual benches, over a real pseudo-terminal."""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from annotated_types import Ge, Le

from benchtool.commands.declared import declared
from benchtool.core.errors import BenchError, DeviceStopped, NoDevice, StandstillNotSeen
from benchtool.core.inputs import Input, Inputs

if TYPE_CHECKING:
    from collections.abc import Iterator

STEPS = 4

SLOWER = 4.0
"""A sweep that came too late is made again so many times slower."""

LATE = {BenchError.exit_code, DeviceStopped.exit_code, StandstillNotSeen.exit_code}
"""Exit codes of a sweep whose orders or samples came too late."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DemoInputs(Inputs):
    """What `benchtool demo` takes."""

    out: Annotated[
        Path | None, Input("New folder.", empty="benchtool-demo, then benchtool-demo-2")
    ] = None
    speed: Annotated[
        float, Ge(1.0), Le(1000.0), Input("How much faster than life the virtual benches run.")
    ] = 20.0
    seed: Annotated[int, Ge(0), Input("Seed of the virtual benches' noise.")] = 1


@declared(DemoInputs)
def demo(inputs: DemoInputs) -> None:
    """Sweep two virtual benches, fit, and write a report."""
    from benchtool.data.run.run import free_path
    from benchtool.report.fit.page import refuse_full

    speed, seed = inputs.speed, inputs.seed
    out = inputs.out or free_path(Path("benchtool-demo"))
    refuse_full(out)
    out.mkdir(parents=True, exist_ok=True)
    print(f"two virtual benches, {speed:g} times faster than life; no motor turns anywhere")
    print(f"everything goes into {out}")
    commands: list[str] = []
    runs = {}
    for step, (name, rig) in enumerate((("single", "pquad_single"), ("quad", "pquad")), start=1):
        _say(step, f"sweep {'one rotor' if name == 'single' else 'the quadrotor'}")
        runs[name] = _swept(name, rig, out / "runs" / name, speed, seed, commands)
    _say(3, "fit: one rotor by eq. (2); four rotors by eq. (3) and by eq. (4)")
    _fit_and_report(out, runs, commands)


def _say(step: int, text: str) -> None:
    print(f"\n[{step}/{STEPS}] {text}", flush=True)


def _swept(name: str, rig: str, run: Path, speed: float, seed: int, commands: list[str]) -> Path:
    """Sweep a virtual bench, again and slower where this computer is too busy; return the run."""
    from importlib.resources import as_file, files

    from benchtool.report.fit.demo import TRUTHS

    link = "tcp:0" if os.name == "nt" else "pty"
    packaged = files("benchtool") / "library" / "plans" / f"demo_{name}.toml"
    while True:
        serve = ["bench", "serve", "--rig", rig, "--truth", TRUTHS[name], "--link", link]
        serve += ["--speed", f"{speed:g}", "--seed", str(seed)]
        with as_file(packaged) as plan, _served(serve) as address:
            sweep = ["sweep", address, "--rig", rig, "--plan", str(plan), "--yes", "--out"]
            typed = ["sweep", address, "--rig", rig, "--plan", plan.name, "--yes", "--out"]
            shown = [f"benchtool {' '.join(words)}" for words in (serve, [*typed, str(run)])]
            for line in shown:
                print(f"$ {line}", flush=True)
            done = subprocess.run(
                [sys.executable, "-m", "benchtool", *sweep, str(run)], check=False
            )
        if done.returncode == 0:
            commands += shown
            return run
        if done.returncode not in LATE or speed <= 1.0:
            print("that virtual bench ended with its sweep; type benchtool demo to begin again")
            sys.exit(done.returncode)
        speed = max(1.0, speed / SLOWER)
        run = run.with_name(f"{name}-at-{speed:g}")
        print(
            f"\nThis computer was too busy to be so quick. The same sweep again, {speed:g} times "
            f"faster than life, into {run}:",
            flush=True,
        )


@contextmanager
def _served(words: list[str]) -> Iterator[str]:
    """Run a virtual bench as a process of its own; gives its address."""
    bench = subprocess.Popen(
        [sys.executable, "-m", "benchtool", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    try:
        assert bench.stdout is not None
        address = bench.stdout.readline().strip()
        if not address:
            raise NoDevice(
                f"the virtual bench ended before it answered; run it by hand to see why: "
                f"benchtool {' '.join(words)}"
            )
        yield address
    finally:
        bench.terminate()
        bench.wait(timeout=10.0)


def _fit_and_report(out: Path, runs: dict[str, Path], commands: list[str]) -> None:
    from benchtool.commands.terminal.show_fit import print_fit, working
    from benchtool.report.fit.demo import STORY, fit_both, verdict
    from benchtool.report.fit.page import write_fit
    from benchtool.report.fit.stored_fit import stored
    from benchtool.report.html import write_report

    both = "--method least_squares --method emcee"
    commands += [
        f"benchtool fit {runs['single']} --model single_bench {both}",
        f"benchtool fit {runs['quad']} --model quad_bench {both} --compare single --compare quad",
    ]
    with working() as show:
        story = fit_both(runs, show)
    print_fit(stored(story.eq4))
    _say(4, "write the report")
    for name, output in (("single", story.single), ("quad", story.eq4)):
        write_fit(out / "fits" / name, output, commands)
    page = write_report(out / "report.html", STORY.report(story, commands))
    print(f"\n{verdict(story)}")
    print(f"\nThe report: {page.resolve()}")
