"""Time MCAP against Parquet, there and back: python tests/proof/benchmarks/bench_mcap.py [ROWS]"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from time import perf_counter

import numpy as np

from benchtool.core.recording import Recording
from benchtool.data.columns import find_channel
from benchtool.data.parquet import read_parquet, write_parquet
from benchtool.data.run.recording_file import read_mcap, write_mcap

NAMES = ("time_s", "thrust_N", "rpm1", "voltage_V")


def main() -> None:
    """Print a line for each format, twice, after what came back was compared."""
    rows = int(next(iter(sys.argv[1:]), "1000000"))
    values = np.round(np.random.default_rng(1).normal(size=(rows, len(NAMES))), 4)
    values[:, 0] = np.arange(rows) / 1000.0
    made = Recording(tuple(map(find_channel, NAMES)), values)
    with tempfile.TemporaryDirectory() as folder:
        formats = (("parquet", write_parquet, read_parquet), ("mcap", write_mcap, read_mcap))
        for name, write, read in formats * 2:
            path = Path(folder) / f"samples.{name}"
            start = perf_counter()
            write(path, made)
            between = perf_counter()
            back = read(path)
            end = perf_counter()
            assert back.values.tobytes() == values.tobytes()
            print(f"{name}: write {between - start:.2f} s, read {end - between:.2f} s")


if __name__ == "__main__":
    main()
