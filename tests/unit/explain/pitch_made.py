"""Recordings of pitch benches that hide something, made in memory."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchtool.core.recording import Recording
from benchtool.core.schedule import load_schedule
from benchtool.physics.model import Model
from benchtool.simulate.controllers.pitch import PitchControl
from benchtool.simulate.gain_file import load_gains
from benchtool.simulate.pitch.bench import PitchBench
from benchtool.simulate.pitch.run import PitchJob
from benchtool.simulate.pitch.simulate import simulate_pitch

RATE_HZ = 250.0


def recorded(
    truth: Model,
    seed: int,
    *,
    seconds: float = 30.0,
    inertia: float = 0.0305,
    schedule: str = "identify",
) -> Recording:
    """Return what a bench of that truth logs along a shipped schedule."""
    control = PitchControl(name="pid", gains=load_gains("s3"), rate_Hz=RATE_HZ)
    bench = replace(PitchBench.from_model(truth), inertia_kgm2=inertia)
    sampled = load_schedule(schedule).with_duration(seconds).sampled(
        RATE_HZ, truth.rig.propulsion.radius_m
    )  # fmt: skip
    return simulate_pitch(PitchJob(bench, control), sampled, seed).recording(truth.rig)


def without(recording: Recording, pattern: str) -> Recording:
    """Return the recording without the channels whose whole name matches."""
    return of_columns(
        recording,
        {
            name: recording.column(name)
            for name in recording.names
            if not re.fullmatch(pattern, name)
        },
    )


def changed(recording: Recording, **columns: NDArray[np.float64]) -> Recording:
    """Return the recording with some columns of other values."""
    held = {name: recording.column(name) for name in recording.names}
    return of_columns(recording, held | columns)


def of_columns(recording: Recording, columns: dict[str, NDArray[np.float64]]) -> Recording:
    """Return a recording of those columns, all else as in another one."""
    pairs = [
        (recording.channels[recording.index(name)], values) for name, values in columns.items()
    ]
    return Recording.from_columns(pairs, recording.provenance, recording.simulated)
