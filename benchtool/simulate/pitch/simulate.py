"""One run of the pitch bench: with a built-in controller, or with anybody's own class."""

from __future__ import annotations

import numpy as np

from benchtool.core.errors import InputError
from benchtool.core.schedule import SampledSchedule
from benchtool.simulate.pitch.own import PitchController, own_ticks
from benchtool.simulate.pitch.result import PitchRun
from benchtool.simulate.pitch.run import PitchJob, PitchLoop


def simulate_pitch(
    job: PitchJob, schedule: SampledSchedule, seed: int = 0, run: int = 0
) -> PitchRun:
    """Return one run with a built-in controller.

    Args:
        job: bench and controller.
        schedule: commands at every control tick.
        seed: of the noise.
        run: number of the run under that seed; run 3 of seed 7 is the same in any batch.
    """
    loop = PitchLoop([job], schedule, seed, [run])
    loop.run()
    return taken(loop, 0, job.control.name)


def simulate_controller(
    controller: PitchController,
    job: PitchJob,
    schedule: SampledSchedule,
    seed: int = 0,
    run: int = 0,
    name: str = "own",
) -> PitchRun:
    """Return one run with a controller of the user's own.

    The loop stops at every control tick, hands the readings over, and takes a `PitchCommand` or
    a plain torque in N m. Feedforward and mixer stay the bench's, as `job.control` says.

    Raises:
        InputError: the controller raised, or returned what is no finite number.
    """
    loop = PitchLoop([job], schedule, seed, [run], external=True)
    own_ticks(loop)(controller, 0, len(schedule), 0)
    return taken(loop, 0, name)


def taken(loop: PitchLoop, lane: int, name: str) -> PitchRun:
    """Return one lane of a loop that has run."""
    log = np.ascontiguousarray(loop.log[:, :, lane])
    if not np.isfinite(log).all():
        tick = int(np.argmax(~np.isfinite(log).all(axis=1)))
        raise InputError(
            f"the simulation of {name!r} left the finite numbers at "
            f"{tick / loop.schedule.rate_Hz:g} s; check gains and parameters"
        )
    return PitchRun(
        controller=name,
        rate_Hz=loop.schedule.rate_Hz,
        log=log,
        clamped_steps=int(loop.view("hinge.clamped_steps")[0, lane]),
        stopped_steps=int(loop.view("hinge.stopped_steps")[0, lane]),
    )
