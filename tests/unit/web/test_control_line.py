from __future__ import annotations

from pathlib import Path

import pytest

from benchtool.web.bench_process.client import BenchClient
from benchtool.web.bench_process.messages import Command, HoldThrottle, ReleaseThrottle
from benchtool.web.context import ServerState
from benchtool.web.control_line import forward


class RecordingClient(BenchClient):
    """Record the commands to the bench process."""

    def __init__(self) -> None:
        super().__init__()
        self.commands: list[Command] = []

    def send(self, command: Command) -> None:
        self.commands.append(command)


@pytest.mark.parametrize(
    ("word", "commands"),
    [
        ("hold 7 1300 1,2 40", [HoldThrottle("a", 7, 1300.0, (1, 2), 0.04)]),
        ("release 7", [ReleaseThrottle("a", 7)]),
        ("hold 7 1300 1,2", []),
        ("hold 7 nan 1 0", []),
        ("hold 7 1300 1 -40", []),
        ("hold 7 1300 1 40\n", []),
        ("release", []),
        ("arm", []),
    ],
)
def test_only_whole_reports_of_the_throttle_are_forwarded(
    word: str, commands: list[Command]
) -> None:
    bench = RecordingClient()
    forward(ServerState(runs=Path("runs"), bench=bench), "a", word)
    assert bench.commands == commands
