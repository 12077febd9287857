"""Read a pitch experiment back from a run folder."""

from __future__ import annotations

import os
import re
from pathlib import Path

from benchtool.core.channel import Channel
from benchtool.core.errors import FileFormatError
from benchtool.core.recording import Recording
from benchtool.core.user_file import open_file
from benchtool.data.columns import code_of
from benchtool.data.run.read import read_samples, sample_names

NEEDED = ("theta_ref_rad", "theta_rad", "gyro_rad_s")
"""Channels without which a run is no pitch experiment."""

LONGEST_HEADER = 1 << 16
"""Bytes of the first line that are looked at; a choice."""

_OTHERS = re.compile(r"pwm\d+_us|rpm\d+|plate_z_m|torque_Nm|disturbance_Nm|voltage_V|thrust_N")


def read_pitch(path: str | Path) -> Recording:
    """Return the experiment of a run that `benchtool record` made, as pitch recordings are.

    Only what was recorded at full collective, not the ramps. time_s is the device's own time since
    then, evenly spaced; a channel without a new value is nan.

    Args:
        path: a run folder or a samples.csv.
    """
    present = sample_names(path)
    for name in NEEDED:
        if name not in present:
            raise FileFormatError(
                str(path), f"there is no {name} in it; name a run of benchtool record"
            )
    wanted = [name for name in present if _OTHERS.fullmatch(name)]
    samples = read_samples(path, ["device_time_us", "phase", *NEEDED, *wanted])
    kept = samples.select(samples.column("phase") == code_of("phase", "sample"))
    if not len(kept):
        raise FileFormatError(
            str(path), "it ended before the collective was reached; record it again"
        )
    device_us = kept.column("device_time_us")
    names = [*NEEDED, *wanted]
    pairs = [(Channel("time_s", "s"), 1e-6 * (device_us - device_us[0]))]
    pairs += [(kept.channels[kept.index(name)], kept.column(name)) for name in names]
    return Recording.from_columns(pairs, kept.provenance, kept.simulated)


def is_pitch_run(path: str | Path) -> bool:
    """Tell whether a run folder holds a pitch experiment, by the channels of its samples."""
    file = Path(path) / "samples.csv"
    if not os.path.lexists(file):
        return False
    with open_file(file, follow=False) as lines:
        first = lines.readline(LONGEST_HEADER)
    return b"theta_rad" in first.strip().split(b",")
