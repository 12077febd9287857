"""Print what campaigns cost against their number of runs: time grows with it, memory does not.

Each line is a process of its own, warmed up by its first runs, that writes its table to disk as
`benchtool simulate ... --vary` does: flights of 5 s up to an obstacle with gyro noise, and pitch
runs of 10 s. Processor time is of all threads. Memory is the peak of the resident set, less what it
was before the first run that counts. `bench_campaign.py flight 32000` prints one line.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

from benchtool.core.rig_file import load_rig_by_name
from benchtool.data.parquet import write_campaign
from benchtool.simulate.campaign import Campaign, Design
from benchtool.simulate.flight.setup import FlightSetup
from benchtool.simulate.flight.vehicle import FlightVehicle
from benchtool.simulate.gain_file import load_gains
from benchtool.simulate.inputs import PitchInputs
from benchtool.simulate.pitch.setup import pitch_setup

RUNS = {"flight": (500, 2000, 8000), "pitch": (1000, 4000, 16000)}  # how many runs each line has

WARM = {"flight": 40, "pitch": 640}
"""Runs before: they compile, and fill the buffers that are used again."""


def campaign(kind: str) -> Campaign:
    """Return what is run."""
    if kind == "pitch":
        setup = pitch_setup(PitchInputs(controllers=("pid",)))
        short = replace(setup, schedule=setup.schedule.with_duration(10.0))
        return Campaign({"s3": short}, ("pid",))
    flight = FlightSetup(
        case="over",
        vehicle=FlightVehicle.of_rig(load_rig_by_name("pquad")),
        gains=load_gains("s3"),
        speed_m_s=1.0,
        duration_s=5.0,
        gyro_noise_rad_s=0.015,
    )
    return Campaign({"s3": flight}, ("pid",))


def write(kind: str, runs: int, folder: Path) -> tuple[float, float]:
    """Run a campaign into a table of that many rows; return time and processor time it took."""
    design = Design.read(["gains.attitude=0.9:1.1:10"], seeds=runs // 10)
    began, used = time.perf_counter(), time.process_time()
    done = write_campaign(campaign(kind).rows(design), folder / f"{runs}.parquet", {})
    assert done == runs
    return time.perf_counter() - began, time.process_time() - used


def peak_MB() -> float:
    """Return the peak of this process's resident set."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1024.0**2 if sys.platform == "darwin" else 1024.0)


def one_line(kind: str, runs: int) -> None:
    """Run one size and print its line."""
    with tempfile.TemporaryDirectory() as folder:
        write(kind, WARM[kind], Path(folder))
        before = peak_MB()
        took_s, used_s = write(kind, runs, Path(folder))
        print(
            f"{kind:<8} {runs:>6} runs {took_s:>7.2f} s {runs / took_s:>6.0f} runs/s "
            f"{1e3 * used_s / runs:>7.2f} ms of processor a run "
            f"{peak_MB() - before:>6.1f} MB more than {before:.0f} MB",
            flush=True,
        )


def main() -> None:
    """Run every size in a process of its own."""
    if len(sys.argv) == 3:
        one_line(sys.argv[1], int(sys.argv[2]))
        return
    for kind, sizes in RUNS.items():
        for runs in sizes:
            subprocess.run([sys.executable, __file__, kind, str(runs)], check=True)


if __name__ == "__main__":
    main()
