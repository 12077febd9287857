"""Print what a virtual ten-minute sweep costs, and what the guard costs for each sample.

The aims: about a second for ten minutes of physics at 200 Hz with four rotors; at most 20 us for a
row from parsed frame to disk buffer, of which the limits may take a part.
"""

from __future__ import annotations

import time

import numpy as np

from benchtool.bench.drivers import open_bench
from benchtool.bench.guard import GuardedBench
from benchtool.bench.limit_check import LimitCheck
from benchtool.core.rig_file import rig_named
from benchtool.physics.model_file import load_model
from benchtool.virtual.devices import virtual_plant

RIG = rig_named("pquad")
TRUTH = load_model("quad_body_lift", RIG).model
WINDOW_S = 600.0


def sweep(block_s: float, guarded: bool) -> float:
    """Run ten virtual minutes in blocks, a new pulse every 10 s; return seconds of one core."""
    bench = open_bench("sim:pquad?seed=1")
    with GuardedBench(bench, RIG) if guarded else bench as driven:
        driven.read(0.1)
        start_s, begun_s = time.process_time(), driven.now_s()
        step = 0
        while driven.now_s() - begun_s < WINDOW_S - 1e-6:
            driven.set_pwm(np.full(4, 1300.0 + 5.0 * (step % 40)))
            until_s = driven.now_s() + 10.0
            while driven.now_s() < until_s - 1e-6:
                driven.read(block_s)
            step += 1
        return time.process_time() - start_s


def limits(rows: int) -> float:
    """Return the cost of the limits in seconds for each sample, in blocks of so many rows."""
    plant = virtual_plant(RIG, TRUTH, 1, None, 1000.0)
    plant.tare()
    plant.command_pwm(np.full(4, 1500.0))
    plant.advance(2000)
    blocks = plant.advance(20_000 // rows * rows).reshape(-1, rows, len(plant.channels))
    check = LimitCheck(plant.channels, RIG, RIG.limits, 1.0, 0.0)
    time_s = np.arange(1, rows + 1) * 1e-3
    start_s = time.process_time()
    for number, block in enumerate(blocks):
        assert check.breach(time_s + number * rows * 1e-3, block) is None
    return (time.process_time() - start_s) / (len(blocks) * rows)


def main() -> None:
    """Print a table."""
    for block_s in (10.0, 1.0, 0.1):
        bare, guarded = sweep(block_s, False), sweep(block_s, True)
        print(
            f"ten minutes of pquad at 200 Hz, read in blocks of {block_s:4g} s: {bare:5.2f} s, "
            f"guarded {guarded:5.2f} s"
        )
    for rows in (1, 5, 20, 100):
        print(f"limits, blocks of {rows:3d} rows: {1e6 * limits(rows):6.2f} us a row")


if __name__ == "__main__":
    main()
