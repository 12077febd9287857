"""Print how long the help takes, as a ratio to ``import typer`` alone; the aim is at most 2.

The two are run in turns, so that what else the machine does falls on both alike.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import time

from benchtool.commands.app import COMMANDS

ROUNDS = 15
BASE = ["-c", "import typer"]


def seconds(arguments: list[str]) -> float:
    """Time one fresh interpreter."""
    start_s = time.perf_counter()
    subprocess.run([sys.executable, *arguments], stdout=subprocess.DEVNULL, check=True)
    return time.perf_counter() - start_s


def main() -> None:
    """Time every command's help beside the bare import."""
    for words in [[], *(name.split() for name in COMMANDS)]:
        asked = ["-m", "benchtool", *words, "--help"]
        for arguments in (BASE, asked):
            seconds(arguments)
        pairs = [(seconds(BASE), seconds(asked)) for _ in range(ROUNDS)]
        base_s = statistics.median(base for base, _ in pairs)
        ours_s = statistics.median(ours for _, ours in pairs)
        command = " ".join(["benchtool", *words, "--help"])
        print(
            f"{command:32s} {ours_s * 1e3:6.1f} ms, import typer {base_s * 1e3:6.1f} ms, "
            f"ratio {ours_s / base_s:.2f}"
        )


if __name__ == "__main__":
    main()
