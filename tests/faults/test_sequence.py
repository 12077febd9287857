"""Samples that come twice, out of order, or not at all: each row once, and the right counts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchtool.bench.serial.frames import Decoder, SampleFramer
from tests.faults.loop import Outcome, plan, sweep
from tests.faults.proxy import Fault


def device_times_us(outcome: Outcome) -> list[int]:
    return [int(float(row["device_time_us"])) for row in outcome.rows() if row["device_time_us"]]


@pytest.mark.parametrize(
    ("fault", "repeated"),
    [
        (Fault("duplicate", way="host", only="samples", for_s=1.0), True),
        (Fault("reorder", way="host", only="samples", for_s=1.0), False),
        (Fault("reorder", way="host", only="samples", times=2), False),
    ],
    ids=["twice", "pairs reversed", "one pair reversed"],
)
def test_twice_or_exchanged(tmp_path: Path, fault: Fault, repeated: bool) -> None:
    outcome = sweep(tmp_path, plan("1.36", 4.0), [fault])
    assert fault.hit >= 2
    assert outcome.code == 0, outcome.said
    times_us = device_times_us(outcome)
    assert len(times_us) == len(set(times_us))
    assert times_us == sorted(times_us)
    assert set(times_us) <= set(outcome.seen.rows)
    assert max(np.diff(times_us)) < 100_000
    link = outcome.metadata["link"]
    assert (link["lost"], link["repeated"] > 0) == (0, repeated)
    if repeated:  # all but those that the host did not read any more
        assert link["repeated"] == pytest.approx(fault.hit, abs=20)


def test_samples_that_are_lost_are_counted_one_by_one(tmp_path: Path) -> None:
    lost = Fault("drop", way="host", only="samples", p=0.1, seed=2)
    outcome = sweep(tmp_path, plan("1.36", 4.0), [lost])
    assert lost.hit > 50
    assert outcome.code == 0, outcome.said
    assert outcome.metadata["link"]["lost"] == pytest.approx(lost.hit, abs=3)


def test_a_gap_of_65536_samples_is_counted_by_the_time_that_passed() -> None:
    decoder = Decoder(1)
    times_us = 6100 * np.arange(65_600)  # 164 Hz, 400 s
    lines = SampleFramer(1).frames(times_us, np.ones((len(times_us), 1)))
    kept = [*lines[:3], *lines[3 + 65_536 :]]
    batches = [decoder.feed(line) for line in kept]
    rows = sum(len(batch.values) for batch in batches)
    assert sum(batch.lost for batch in batches) == len(lines) - rows
    assert rows >= len(kept) - 1
