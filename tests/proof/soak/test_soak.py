"""A seeded sample of the soak; `make soak MINUTES=n` goes on for as long as it is given."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

from tests.proof.soak.soak import slope, state_of_process, sweep, tables
from tests.proof.soak.world import REAL

pytestmark = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals are POSIX")

SAMPLE = [
    *(("memory", 24), ("memory", 30), ("mavlink", 22), ("grbl", 24)),
    ("memory", 930676091),  # holds 850 samples back
    ("grbl", 598985610),  # turns a bit of a line of one byte
    *(("pty", 3), ("tcp", 11)),
]


@pytest.mark.parametrize(("kind", "seed"), SAMPLE)
def test_no_row_is_lost_and_no_motor_turns_without_a_host(
    tmp_path: Path, kind: str, seed: int
) -> None:
    outcome = sweep(kind, seed, 1.5 if seed < 100 else 3.0, tmp_path)
    if kind not in REAL:  # in real time a fault may end the sweep before its motors turn
        assert sum(outcome.struck.values()) >= 1
        assert outcome.turned_s > 0.2
    assert outcome.troubles == [], outcome.said


def test_a_process_that_grows_is_told_from_one_that_wavers(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    wavers = 100.0 + rng.normal(size=400)
    rise, error = slope(wavers)
    assert abs(rise) < 3.0 * error
    rise, error = slope(wavers + 0.03 * np.arange(400))
    assert abs(rise - 30.0) < 3.0 * error
    outcome = vars(sweep("memory", 3, 1.0, tmp_path)) | {"said": "", "wall_s": 60.0}
    same = state_of_process()
    notes = tmp_path / "notes.jsonl"
    for sweeps, leaks, last in (
        (120, 0, "0 rows lost, 0 unsafe"),
        (120, 1, "wrong: descriptors: grows by +"),
        (60, 0, "0 rows lost, 0 unsafe"),
    ):
        grown = [{**same, "descriptors": 7 + leaks * (number // 30)} for number in range(sweeps)]
        notes.write_text("".join(json.dumps(outcome | state) + "\n" for state in grown))
        text, wrong = tables(notes)
        assert wrong == leaks
        assert text.splitlines()[-1].startswith(last)
        assert ("too few sweeps for a slope" in text) == (sweeps < 100)
    notes.write_text(json.dumps(outcome | same | {"troubles": ["the last row is torn"]}) + "\n")
    text, wrong = tables(notes)
    assert wrong == 1
    assert text.endswith("wrong: memory, seed 3: the last row is torn\n")
    assert "\n60 s of wall time" in text
