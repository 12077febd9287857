"""Hostile bytes for every parser: read, or refused in a sentence; never anything else."""

from __future__ import annotations

from pathlib import Path
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchtool.core.errors import BenchtoolError
from tests.proof.fuzz.engine import HOSTILE, fault_of, fuzz, watched
from tests.proof.fuzz.targets import Files, Target, targets

FOUND = Path(__file__).parent / "found"
"""Inputs that were faults, one a file: TARGET--WHAT; all are read or refused today."""

NAMES = ("bench link", "bench hello", "mavlink", "side cell", "grbl", "csv",
         "import", "import log", "plan", "rig", "model", "gains", "schedule", "motor map",
         "columns", "recipe", "address", "stage", "link", "virtual fault", "options of sweep",
         "options of fit", "options of calibrate",
         "where", "web request", "calibration", "recording facts", "fit result", "run metadata",
         "run plan", "run points", "run samples", "run settings", "run events")  # fmt: skip


@pytest.fixture(scope="module")
def every():
    on_disk = Files()
    yield targets(on_disk)
    on_disk.close()


def test_every_target_reads_its_first_seed(every):
    assert tuple(every) == NAMES
    for target in every.values():
        target.parse(target.seeds[0])


EDITS = st.lists(
    st.tuples(
        st.floats(0.0, 1.0),
        st.sampled_from((0, 0, 1, 4, 40)),
        st.one_of(st.sampled_from(HOSTILE), st.binary(max_size=8)),
    ),
    max_size=5,
)
"""Changes of a seed: where, so many bytes taken away, and what stands there instead."""


def edited(seed: bytes, edits: list[tuple[float, int, bytes]]) -> bytes:
    for share, taken, put in edits:
        at = round(share * len(seed))
        seed = seed[:at] + put + seed[at + taken :]
    return seed


def searched(target: Target, examples: int) -> int:
    """Let hypothesis look for bytes that a target neither reads nor refuses, and count them."""
    tried = [0]

    @settings(max_examples=examples)
    @given(st.sampled_from(target.seeds), EDITS)
    def holds(seed: bytes, edits: list[tuple[float, int, bytes]]) -> None:
        tried[0] += 1
        assert not fault_of(target, edited(seed, edits))

    holds()
    return tried[0]


@pytest.mark.parametrize("name", NAMES)
def test_no_bytes_are_neither_read_nor_refused(every, name):
    assert searched(every[name], 20) >= 20


@pytest.mark.slow
@pytest.mark.parametrize("name", Random(39).sample(NAMES, 8))
def test_many_bytes_are_read_or_refused(every, name):
    assert searched(every[name], 150) >= 150
    count, faults = fuzz(every[name], Random(name), most=300)
    assert count == 300
    assert faults == {}


@pytest.mark.parametrize("path", sorted(FOUND.iterdir()), ids=lambda path: path.name)
def test_what_was_found_stays_mended(every, path):
    target = every[path.name.partition("--")[0].replace("-", " ")]
    with watched():
        assert not fault_of(target, path.read_bytes())


def test_a_fault_is_found():
    def parse(data: bytes) -> None:
        if b"1e400" in data:
            raise ValueError("not ours")
        raise BenchtoolError("ours")

    count, faults = fuzz(Target("broken", parse, (b"a = 1.5\n",)), Random(1), most=2000)
    assert count == 2000
    assert [fault.split(":")[0] for fault in faults] == ["ValueError"]
