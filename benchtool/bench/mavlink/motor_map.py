"""The small file beside a rig that says how its rotors hang on an autopilot."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from annotated_types import Ge, Le, Len

from benchtool.core.errors import FileFormatError
from benchtool.core.toml_text import FiniteTable, read_strict
from benchtool.core.user_file import read_text

MotorNumber = Annotated[int, Ge(1), Le(12)]
Place = Annotated[int, Ge(0), Le(16)]


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorMap(FiniteTable):
    """Say which motor, output and ESC belongs to each rotor of a rig, in the rig's order.

    Attributes:
        rig: name of the rig.
        autopilot: name of the autopilot that it was learnt on.
        motors: number of each rotor in the autopilot's motor test.
        outputs: output that drives each rotor; 0 where that is not known.
        escs: place of each rotor in speed messages; 0 where it has none.
    """

    rig: str
    autopilot: str
    motors: Annotated[tuple[MotorNumber, ...], Len(1, 12)]
    outputs: tuple[Place, ...]
    escs: tuple[Place, ...]

    def to_toml(self) -> str:
        """Return it as the text of its file."""
        lines = ["# Made by `benchtool bench map`: rotors of the rig on an autopilot."]
        # JSON's strings and lists of numbers are TOML's as well, on one line.
        lines += [
            f"{name} = {json.dumps(value)}" for name, value in dataclasses.asdict(self).items()
        ]
        return "\n".join(lines) + "\n"


def read_motor_map(path: Path) -> MotorMap:
    """Read a map of motors.

    Raises:
        FileFormatError: there is no such file, or it does not say what it must.
    """
    try:
        text = read_text(path)
    except FileFormatError as error:
        raise FileFormatError(
            f"the map of motors {error.where}",
            f"{error.problem}; make one with benchtool bench map",
        ) from error
    found = read_strict(MotorMap, text, str(path))
    if not len(found.motors) == len(found.outputs) == len(found.escs):
        raise FileFormatError(
            str(path), "motors, outputs and escs are not equally long; give one of each per rotor"
        )
    if len(set(found.motors)) < len(found.motors):
        raise FileFormatError(str(path), "motors names one motor twice; each drives one rotor")
    return found
