"""Small runs for the tests of the store."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchtool.data.columns import find_channel
from benchtool.data.run.points import Point
from benchtool.data.run.run import Run

CHANNELS = tuple(find_channel(name) for name in ("pwm1_us", "rpm1", "thrust_N"))


def point(number: int, kind: str, setting: int, repeat: int, thrust_N: float) -> Point:
    return Point(
        point=number,
        kind=kind,
        setting=setting,
        repeat=repeat,
        time_s=10.0 * number,
        elapsed_s=10.0 * number - 1.5,
        pwm_us=(1500.0,),
        rpm=(5000.0 + repeat,),
        rpm_se=(1.5,),
        thrust_N=thrust_N,
        thrust_sd_N=0.1,
        thrust_se_N=0.01,
        n_samples=80,
        plate_z_m=0.1 if kind == "measure" else 1.4,
    )


def small_run(path: Path) -> Run:
    """Return a run with two repeats of one setting and its reference, not closed."""
    run = Run.create(path, "name = 'x'\n", {"simulated": True, "rig": {"name": "one"}})
    samples = run.sample_writer(CHANNELS)
    time_s = np.arange(5) / 200.0
    values = np.array([[1500.0, 5000.0, np.nan]] * 5)
    values[::2, 2] = [1.25, 0.1 + 0.2, -3.0]
    samples.append(1, "settle", time_s, 1e6 * time_s, values)
    samples.append(1, "sample", time_s + 0.025, 1e6 * time_s + 25000, values)
    samples.close()
    points = run.point_writer(1)
    points.append(point(0, "tare", 0, 0, 0.001))
    visits = (
        ("measure", 1, 1, 11.0),
        ("reference", 2, 1, 10.0),
        ("reference", 2, 2, 10.2),
        ("measure", 1, 2, 11.424),
    )
    for number, (kind, setting, repeat, thrust_N) in enumerate(visits, 1):
        points.append(point(number, kind, setting, repeat, thrust_N))
    points.close()
    return run
