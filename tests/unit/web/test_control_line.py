from __future__ import annotations

from pathlib import Path

import pytest

from benchtool.web.bench_link import BenchLink
from benchtool.web.context import Shared
from benchtool.web.control_line import hear
from benchtool.web.desk.asks import Ask, Hold, Release


class Asked(BenchLink):
    """Note what the bench process is asked."""

    def __init__(self) -> None:
        super().__init__()
        self.asks: list[Ask] = []

    def ask(self, ask: Ask) -> None:
        self.asks.append(ask)


@pytest.mark.parametrize(
    ("word", "asks"),
    [
        ("hold 7 1300 1,2 40", [Hold("a", 7, 1300.0, (1, 2), 0.04)]),
        ("release 7", [Release("a", 7)]),
        ("hold 7 1300 1,2", []),
        ("hold 7 nan 1 0", []),
        ("hold 7 1300 1 -40", []),
        ("hold 7 1300 1 40\n", []),
        ("release", []),
        ("arm", []),
    ],
)
def test_only_whole_words_of_the_hand_are_heard(word: str, asks: list[Ask]) -> None:
    bench = Asked()
    hear(Shared(runs=Path("runs"), bench=bench), "a", word)
    assert bench.asks == asks
