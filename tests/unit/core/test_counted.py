"""Counts with their nouns."""

from __future__ import annotations

import pytest

from benchtool.core.counted import counted


@pytest.mark.parametrize(
    ("count", "said"), [(0, "0 rows"), (1, "1 row"), (2, "2 rows"), (3825, "3,825 rows")]
)
def test_one_thing_takes_no_s(count: int, said: str) -> None:
    assert counted(count, "row") == said
