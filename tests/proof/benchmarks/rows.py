"""Rows of the benchmarks, and how their figures are measured.

Processor time is used wherever one process does the work: another load on the machine changes it
little.
"""

from __future__ import annotations

import os
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

TOP = Path(__file__).parents[3]

PEAK_MEMORY = """
import resource, sys
from pathlib import Path
def peak_MB():
    status = Path("/proc/self/status")
    if status.is_file():  # ru_maxrss includes the parent before exec
        return int(status.read_text().partition("VmHWM:")[2].split()[0]) / 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
"""

ALONE = """
import sys, time
arguments = sys.argv[1:]
{setup}
start, used = time.perf_counter(), time.process_time()
{work}
print(time.perf_counter() - start, time.process_time() - used, peak_MB())
"""


# Limits in these units hold on a machine that needs this processor time to import typer.
OF_PROCESSOR = ("s", "us", "% of a core", "times real time", "runs/s")
IMPORT_TYPER_S = 0.048


@dataclass(frozen=True)
class Row:
    """One measured figure; `wanted` limits its ratio to the peer if `of_peer`."""

    work: str
    ours: float
    unit: str
    peer: float | None = None
    peer_name: str = ""
    wanted: float | None = None
    of_peer: bool = False
    size: int = 0  # of a row of scale, in the unit that `work` names last
    memory_MB: float | None = None

    @property
    def is_rate(self) -> bool:
        """Tell whether more is better."""
        return self.unit.endswith(("/s", "real time"))

    @property
    def ratio(self) -> float | None:
        """Return the figure over that of the peer."""
        return None if self.peer is None else self.ours / self.peer

    def limit(self, slowness: float) -> float | None:
        """Return the limit on a machine so many times slower than the one it was set for.

        On a faster machine the limit stays.
        """
        if self.wanted is None or self.of_peer or self.unit not in OF_PROCESSOR or slowness < 1.0:
            return self.wanted
        return self.wanted / slowness if self.is_rate else self.wanted * slowness

    def is_met(self, slowness: float) -> bool | None:
        """Tell whether the figure is within its limit; None without one."""
        figure = self.ratio if self.of_peer else self.ours
        limit = self.limit(slowness)
        if limit is None or figure is None:
            return None
        return figure >= limit if self.is_rate else figure <= limit


def machine_slowness() -> float:
    """Return the processor time of `import typer` over that where the limits were set."""
    times_s = [command_cpu_s("-c", "import typer") for _ in range(6)]
    return statistics.median(times_s[1:]) / IMPORT_TYPER_S


def wall_s(work: Callable[[], object]) -> float:
    """Return how long a call takes: s."""
    start_s = time.perf_counter()
    work()
    return time.perf_counter() - start_s


def cpu_s(work: Callable[[], object]) -> float:
    """Return the processor time of a call, all threads: s."""
    start_s = time.process_time()
    work()
    return time.process_time() - start_s


def in_turns(rounds: int, *works: Callable[[], object], warm: bool = True) -> list[float]:
    """Call each work in turn and return the medians of their processor times: s."""
    for work in works if warm else ():
        work()
    times = [[cpu_s(work) for work in works] for _ in range(rounds)]
    return [statistics.median(column) for column in zip(*times, strict=True)]


def command_cpu_s(
    *arguments: str, code: int = 0, environment: Mapping[str, str] | None = None
) -> float:
    """Return the processor time of a Python process and its children: s."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    ended = subprocess.run(
        [sys.executable, *arguments],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        env={**os.environ, **(environment or {})},
        check=False,
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert ended.returncode == code, ended.stderr.decode()
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def alone(setup: str, work: str, *arguments: object) -> tuple[float, float, float]:
    """Return time (s), processor time (s) and peak memory (MB) of statements in a new process.

    The memory is all of it, interpreter and libraries included.
    """
    code = PEAK_MEMORY + ALONE.format(setup=setup, work=work)
    ended = subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)], capture_output=True, check=False
    )
    assert ended.returncode == 0, ended.stderr.decode()
    wall, cpu, memory = map(float, ended.stdout.split()[-3:])
    return wall, cpu, memory
