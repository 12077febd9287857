"""What closing, resuming and reading a long run cost: processor time and memory.

    python tests/proof/benchmarks/bench_closing.py [ROWS]

ROWS samples of 17 channels; 3,600,000 (an hour at 1 kHz) when left out. Goals for that hour: at
most 30 s of one core and 300 MB to close it; under 1 GB to read some channels of 10,000,000 rows.
Each measurement is a process of its own; memory is all of it, interpreter and libraries included.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

CHANNELS = (
    *(f"pwm{i}_us" for i in (1, 2, 3, 4)),
    *(f"rpm{i}" for i in (1, 2, 3, 4)),
    *("thrust_N", "thrust_raw", "torque_Nm", "plate_z_m", "plate_x_m", "plate_tilt_deg"),
    *("voltage_V", "current_A", "temperature_degC"),
)
VISITS = 100
AT_ONCE = 100_000

MEASURED = """
import sys, time
from pathlib import Path
run = Path(sys.argv[1])
begun = time.process_time()
{statement}
spent = time.process_time() - begun
status = dict(line.split(":", 1) for line in open("/proc/self/status"))
print(spent, int(status["VmHWM"].split()[0]) / 1024)
"""

STATEMENTS = {
    "nothing but imports": "from benchtool.data.run.run import Run"
    "; from benchtool.data.run.read import read_samples",
    "close": "from benchtool.data.run.run import Run; Run.open(run).close()",
    "read for --resume": (
        "from benchtool.data.run.append import install_marked_samples\n"
        "from benchtool.data.run.run import Run\n"
        "Run(run).prepare_samples(frozenset(range(1, 100)))\n"
        "install_marked_samples(run / 'samples.csv')"
    ),
    "mean thrust of closed samples": (
        "from benchtool.data.run.read import read_samples\n"
        "read_samples(run, ['time_s', 'phase', 'thrust_N']).column('thrust_N').mean()"
    ),
    "mean thrust of samples.csv": (
        "from benchtool.data.run.read import read_samples\n"
        "read_samples(run / 'samples.csv', ['time_s', 'phase', 'thrust_N']).values.mean(0)"
    ),
}


def make_run(path: Path, rows: int) -> None:
    """Write a run of so many rows, the last tenth of the last visit's phase cut short."""
    import numpy as np
    import pyarrow as pa
    from pyarrow import csv

    from benchtool.data.run.points import Point
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
        points.append(
            Point(
                point=number,
                kind="measure",
                setting=1,
                repeat=number,
                time_s=float(number),
                elapsed_s=1.0,
                pwm_us=four,
                rpm=four,
                rpm_se=four,
                thrust_N=10.0,
                thrust_sd_N=0.1,
                thrust_se_N=0.01,
                n_samples=100,
                plate_z_m=0.1,
            )
        )
    points.close()


def measured(run: Path, statement: str) -> tuple[float, float]:
    """Return processor time in s and the most memory in MB of a process that does this."""
    code = MEASURED.format(statement=statement)
    words = [sys.executable, "-c", code, str(run)]
    told = subprocess.run(words, capture_output=True, text=True, check=True).stdout.split()
    return float(told[0]), float(told[1])


if __name__ == "__main__":
    rows = int(sys.argv[1]) if len(sys.argv) > 1 else 3_600_000
    with tempfile.TemporaryDirectory() as folder:
        run = Path(folder) / "run"
        make_run(run, rows)
        size = (run / "samples.csv").stat().st_size / 2**20
        print(f"{rows:,} rows of {len(CHANNELS)} channels, samples.csv {size:.0f} MB")
        for name, statement in STATEMENTS.items():
            spent_s, most_MB = measured(run, statement)
            print(f"{name:32} {spent_s:6.1f} s {most_MB:6.0f} MB", flush=True)
