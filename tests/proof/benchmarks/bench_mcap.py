"""MCAP beside Parquet, written and read back."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchtool.core.recording import Recording
from benchtool.data.columns import find_channel
from benchtool.data.parquet import read_parquet, write_parquet
from benchtool.data.run.recording_file import read_mcap, write_mcap
from tests.proof.benchmarks.rows import Row, in_turns

NAMES = ("time_s", "thrust_N", "rpm1", "voltage_V")


def rows(quick: bool) -> Iterator[Row]:
    """Yield writing and reading; what comes back is compared."""
    count = 1000 if quick else 1_000_000
    values = np.round(np.random.default_rng(1).normal(size=(count, len(NAMES))), 4)
    values[:, 0] = np.arange(count) / 1000.0
    recording = Recording(tuple(map(find_channel, NAMES)), values)
    with tempfile.TemporaryDirectory() as folder:
        mcap, parquet = Path(folder) / "samples.mcap", Path(folder) / "samples.parquet"
        ours, peer = in_turns(
            1, lambda: write_mcap(mcap, recording), lambda: write_parquet(parquet, recording),
            warm=False,
        )  # fmt: skip
        yield Row(f"MCAP, write {count:,} rows", ours, "s", peer, "Parquet")
        ours, peer = in_turns(1, lambda: read_mcap(mcap), lambda: read_parquet(parquet))
        yield Row(f"MCAP, read {count:,} rows", ours, "s", peer, "Parquet")
        assert read_mcap(mcap).values.tobytes() == values.tobytes()
