"""Closing, resuming and reading a run of an hour at 1 kHz with 17 channels.

Each measurement is a process of its own.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from tests.proof.benchmarks.rows import Row, alone
from tests.unit.data.run_of import point

CHANNELS = (
    *(f"pwm{i}_us" for i in (1, 2, 3, 4)),
    *(f"rpm{i}" for i in (1, 2, 3, 4)),
    *("thrust_N", "thrust_raw", "torque_Nm", "plate_z_m", "plate_x_m", "plate_tilt_deg"),
    *("voltage_V", "current_A", "temperature_degC"),
)
VISITS = 100
AT_ONCE = 100_000

WORKS = {  # name: statements, and the limit in s
    "import": ("import benchtool.data.run.run, benchtool.data.run.read", None),
    "close": ("from benchtool.data.run.run import Run; Run.open(run).close()", 30.0),
    "read for --resume": (
        "from benchtool.data.run.append import install_marked_samples\n"
        "from benchtool.data.run.run import Run\n"
        "Run(run).prepare_samples(frozenset(range(1, 100)))\n"
        "install_marked_samples(run / 'samples.csv')",
        None,
    ),
    "mean of closed samples": (
        "from benchtool.data.run.read import read_samples\n"
        "read_samples(run, ['time_s', 'phase', 'thrust_N']).column('thrust_N').mean()",
        None,
    ),
    "mean of samples.csv": (
        "from benchtool.data.run.read import read_samples\n"
        "read_samples(run / 'samples.csv', ['time_s', 'phase', 'thrust_N']).values.mean(0)",
        None,
    ),
}


def make_run(path: Path, rows: int) -> None:
    """Write a run of so many rows, the last tenth of the last visit's phase cut short."""
    import numpy as np
    import pyarrow as pa
    from pyarrow import csv

    from benchtool.data.run.run import Run

    rig = {"name": "bench"}
    run = Run.create(path, "", {"simulated": True, "rig": rig, "state": "running"})
    rng = np.random.default_rng(1)
    names = ["time_s", "device_time_us", "point", "phase", *CHANNELS]
    with open(path / "samples.csv", "wb") as file:
        file.write(",".join(names).encode() + b"\n")
        for start in range(0, rows, AT_ONCE):
            count = min(AT_ONCE, rows - start)
            at = np.arange(start, start + count)
            columns = [pa.array(at / 1000.0), pa.array(at * 1000)]
            columns.append(pa.array(1 + at * VISITS // rows))
            columns.append(pa.array(np.where(at % 2000 < 1000, "settle", "sample")))
            columns += [
                pa.array(np.round(1000.0 + rng.normal(size=count), 4), mask=rng.random(count) < 0.1)
                for _ in CHANNELS
            ]
            table = pa.table(columns, names=names)
            csv.write_csv(table, file, csv.WriteOptions(include_header=False, quoting_style="none"))
    points = run.point_writer(4)
    four = (1500.0,) * 4
    for number in range(1, VISITS):
        visit = point(number, "measure", 1, number, 10.0)
        points.append(replace(visit, pwm_us=four, rpm=four, rpm_se=four))
    points.close()


def rows(quick: bool) -> Iterator[Row]:
    """Yield one row for each work."""
    count = 20_000 if quick else 3_600_000
    with tempfile.TemporaryDirectory() as folder:
        run = Path(folder) / "run"
        make_run(run, count)
        for name, (statements, limit_s) in WORKS.items():
            setup = "from pathlib import Path; run = Path(arguments[0])"
            _, used_s, memory_MB = alone(setup, statements, run)
            work = f"a run of {count:,} rows: {name}"
            yield Row(work, used_s, "s", wanted=limit_s, memory_MB=memory_MB)
