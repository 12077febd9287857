"""Number of rotors in a recording, checked against the model."""

from __future__ import annotations

import re

import numpy as np

from benchtool.core.errors import InputError
from benchtool.core.recording import Recording
from benchtool.core.rig import Rig

ROTOR = re.compile(r"(?:rpm|pwm)(\d+)(?:_us)?")


def check_rotor_count(recording: Recording, rig: Rig, name: str, *, lacking: bool = False) -> None:
    """Raise InputError for more active rotors than in the rig, or fewer with `lacking`."""
    present = count_rotors(recording)
    if not present:
        return
    rig_count, count = len(rig.rotors), max(present)
    if count > rig_count or (lacking and count < rig_count):
        raise InputError(
            f"{name} has pulses or speeds of {_rotors(count)}, and the model {rig_count} (rig "
            f"{rig.name!r}); name the model of this bench with --model, or map the rotors' columns "
            f"in its [columns]"
        )


def count_rotors(recording: Recording) -> tuple[int, ...]:
    """Return the numbers (from 1) of the rotors whose pulse or speed changes, in order.

    A constant channel may be unconnected.
    """
    numbers = set()
    for name in recording.names:
        number = ROTOR.fullmatch(name)
        if number is None:
            continue
        values = recording.column(name)
        finite = values[np.isfinite(values)]
        if len(finite) and np.ptp(finite) > 0.0:
            numbers.add(int(number[1]))
    return tuple(sorted(numbers))


def _rotors(count: int) -> str:
    return "1 rotor" if count == 1 else f"{count} rotors"
