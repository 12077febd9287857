"""Count the rotors of a recording, and refuse a model that has another number."""

from __future__ import annotations

import re

import numpy as np

from benchtool.core.errors import InputError
from benchtool.core.recording import Recording
from benchtool.core.rig import Rig

ROTOR = re.compile(r"(?:rpm|pwm)(\d+)(?:_us)?")


def check_rotor_count(recording: Recording, rig: Rig, name: str, *, lacking: bool = False) -> None:
    """Refuse a recording in which more rotors turn than a rig has, or fewer with `lacking`.

    Raises:
        InputError: another number, with both.
    """
    present = count_rotors(recording)
    if not present:
        return
    known, more = len(rig.rotors), max(present)
    if more > known or (lacking and more < known):
        raise InputError(
            f"{name} has pulses or speeds of {_rotors(more)}, and the model {known} (rig "
            f"{rig.name!r}); name the model of this bench with --model, or map the rotors' columns "
            f"in its [columns]"
        )


def count_rotors(recording: Recording) -> tuple[int, ...]:
    """Return the numbers (from 1) of the rotors whose pulse or speed changes, in order.

    A channel that stands still may be one that nobody connected.
    """
    found = set()
    for name in recording.names:
        number = ROTOR.fullmatch(name)
        if number is None:
            continue
        values = recording.column(name)
        known = values[np.isfinite(values)]
        if len(known) and np.ptp(known) > 0.0:
            found.add(int(number[1]))
    return tuple(sorted(found))


def _rotors(count: int) -> str:
    return "1 rotor" if count == 1 else f"{count} rotors"
