"""Commands as whole processes: help, errors, a small fit, and the first call after an install."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchtool.commands.app import COMMANDS
from tests.proof.benchmarks.rows import Row, command_cpu_s


def write_points(path: Path, count: int) -> list[str]:
    """Write points of one rotor near a plate; return the arguments that fit them."""
    radius_m = 0.127
    z_m = radius_m * np.geomspace(0.6, 4.0, count)
    noise = 1.0 + 0.001 * np.random.default_rng(1).standard_normal(count)
    thrust_N = 3.2 / (1.0 - (radius_m / 4.0 / z_m) ** 2) * noise
    table = np.column_stack((z_m, thrust_N, np.full(count, 6000.0)))
    np.savetxt(path, table, "%.6f", ",", header="plate_z_m,thrust_N,rpm1", comments="")
    return ["fit", str(path), "--model", "single", "--rig", "pquad_single"]


def rows(quick: bool) -> Iterator[Row]:
    """Yield one row for each kind of command."""

    def call(*arguments: str, code: int = 0, **environment: str) -> float:
        words = ("-m", "benchtool", *arguments)
        return command_cpu_s(*words, code=code, environment=environment)

    command_cpu_s("-c", "import typer")
    typer_s = command_cpu_s("-c", "import typer")
    used_s = command_cpu_s("-c", "import benchtool")
    yield Row("import benchtool", used_s, "s", typer_s, "import typer", 0.05)
    used_s = call("--help")
    yield Row("benchtool --help", used_s, "s", typer_s, "import typer", 1.5, of_peer=True)
    names = list(COMMANDS)[: 2 if quick else None]
    times_s = [call(*name.split(), "--help") for name in names]
    median_s = float(np.median(times_s))
    work = "median of the help of all commands"
    yield Row(work, median_s, "s", typer_s, "import typer", 1.5, of_peer=True)
    yield Row("usage error", call("fit", "--nope", code=2), "s", wanted=0.4)
    with tempfile.TemporaryDirectory() as folder:
        arguments = write_points(Path(folder) / "points.csv", 40)
        call(*arguments)
        yield Row("fit of 40 points, no report", call(*arguments), "s", wanted=1.0)
        simulate = ("simulate", "pitch")
        empty_cache = {} if quick else {"NUMBA_CACHE_DIR": folder}
        first_s = call(*simulate, **empty_cache)
        yield Row("first call after an install: simulate pitch", first_s, "s", wanted=8.0)
        yield Row("simulate pitch, compiled", call(*simulate), "s", wanted=2.5)
