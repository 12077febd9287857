"""Work on all cores: results in order, no more taken ahead than threads can use."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from threading import Barrier

import pytest

from benchtool.core.errors import InputError
from benchtool.simulate.loop import results_in_order


def counting(taken: list[int], count: int) -> Iterator[Callable[[], int]]:
    for number in range(count):
        taken.append(number)
        yield partial(int, number)


@pytest.mark.parametrize("threads", [1, 2, 5, None])
def test_results_come_in_the_order_of_the_tasks(threads):
    assert list(results_in_order(counting([], 50), threads)) == list(range(50))


def test_tasks_run_at_the_same_time():
    meeting = Barrier(2, timeout=10.0)  # is passed only when two wait at once
    assert sorted(results_in_order([meeting.wait, meeting.wait], 2)) == [0, 1]


def test_a_task_that_fails_ends_the_work_and_starts_no_more():
    taken: list[int] = []

    def fail() -> int:
        raise InputError("no such flight")

    def tasks() -> Iterator[Callable[[], int]]:
        yield partial(int, 1)
        yield fail
        yield from counting(taken, 1000)

    results = results_in_order(tasks(), 2)
    assert next(results) == 1
    with pytest.raises(InputError, match="no such flight"):
        list(results)
    assert len(taken) <= 3
