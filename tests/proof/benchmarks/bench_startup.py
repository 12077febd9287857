"""Print the CPU time of every help as a ratio to ``import typer`` alone; the aim is at most 1.3.

All are run in turns, so that what else the machine does falls on each alike. ``import benchtool``
is to take at most 50 ms.
"""

from __future__ import annotations

import os
import sys
from statistics import median

from benchtool.commands.app import COMMANDS

ROUNDS = 15
BASE = "import typer"


def cpu_ms(arguments: list[str]) -> float:
    """Time one fresh interpreter, user and system."""
    discarded = [(os.POSIX_SPAWN_OPEN, 1, os.devnull, os.O_WRONLY, 0)]
    command = [sys.executable, *arguments]
    pid = os.posix_spawn(sys.executable, command, os.environ, file_actions=discarded)
    _, status, usage = os.wait4(pid, 0)
    assert status == 0
    return 1e3 * (usage.ru_utime + usage.ru_stime)


def main() -> None:
    """Time every command's help beside the bare import; the first round fills the caches."""
    programs = {text: ["-c", text] for text in (BASE, "import benchtool")}
    for command in ("", *COMMANDS):
        words = ["benchtool", *command.split(), "--help"]
        programs[" ".join(words)] = ["-m", *words]
    rounds = [{name: cpu_ms(program) for name, program in programs.items()}
              for _ in range(ROUNDS + 1)][1:]  # fmt: skip
    for name in programs:
        times = [one[name] for one in rounds]
        ratio = median(one[name] / one[BASE] for one in rounds)
        print(f"{name:32s} median {median(times):6.1f} ms, least {min(times):6.1f} ms, "
              f"ratio {ratio:.2f}")  # fmt: skip


if __name__ == "__main__":
    main()
