"""The targets of `benchtool export`, by name."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from benchtool import __version__
from benchtool.core.errors import UnknownChoice, WouldOverwrite
from benchtool.data.atomic import make_folder, replace_text
from benchtool.export.autopilots import ardupilot, betaflight, px4
from benchtool.export.c_header import c_header
from benchtool.export.render import render
from benchtool.export.vehicle import Vehicle


@dataclass(frozen=True, slots=True)
class Target:
    """Export target.

    Attributes:
        file: file name, with "{name}" for the rig name.
        comment: format of a comment line.
    """

    title: str
    file: str
    write: Callable[[Vehicle], str]
    comment: str = "# {}"

    def text(self, vehicle: Vehicle) -> str:
        """Return the content of the file, with its source in the first comment lines."""
        lines = [f"rig {vehicle.rig.name}, model {vehicle.model.name}; benchtool {__version__}"]
        if vehicle.simulated:
            lines.append("SIMULATED: the data of the fit or motor test are from a virtual bench")
        header = "\n".join(self.comment.format(line) for line in lines)
        body = self.write(vehicle)
        if body.startswith("<?xml"):
            declaration, _, content = body.partition("\n")
            return f"{declaration}\n{header}\n{content}\n"
        return f"{header}\n{body}\n"


XML = "<!-- {} -->"
sdf, mujoco, rotorpy = (partial(render, name) for name in ("sdf", "mujoco", "rotorpy"))

TARGETS: Mapping[str, Target] = {  # values of `benchtool export --to`
    "sdf": Target("Gazebo: SDF with MulticopterMotorModel", "{name}.sdf", sdf, XML),
    "mujoco": Target("MuJoCo: MJCF with thrust actuators", "{name}.xml", mujoco, XML),
    "rotorpy": Target("rotorpy: a module with quad_params", "{name}_params.py", rotorpy),
    "ardupilot": Target("ArduPilot: MOT_* parameters", "{name}.param", ardupilot),
    "px4": Target("PX4: CA_ROTOR*, THR_MDL_FAC", "{name}.params", px4),
    "betaflight": Target("Betaflight: thrust_linear", "{name}.cli.txt", betaflight),
    "c": Target("C header: thrust and throttle near a surface", "{name}.h", c_header, "/* {} */"),
}


def find_target(name: str) -> Target:
    """Return a target by name; raise UnknownChoice for an unknown one."""
    if name not in TARGETS:
        raise UnknownChoice("target", name, (*TARGETS, "all"))
    return TARGETS[name]


def write_targets(vehicle: Vehicle, to: str, out: Path | None = None) -> tuple[Path, ...]:
    """Write the file of a target, or a folder for "all"; return the paths.

    Args:
        out: new file, or new folder for "all"; default: named after the rig.

    Raises:
        UnknownChoice: unknown target.
        InputError: the target cannot represent the model.
        WouldOverwrite: the path exists.
    """
    if to == "all":
        folder = out if out is not None else Path(f"{vehicle.name}-export")
        texts = {
            folder / _file(target, vehicle): target.text(vehicle) for target in TARGETS.values()
        }
        if os.path.lexists(folder):
            raise WouldOverwrite(str(folder))
        make_folder(folder)
    else:
        file, text = file_for(vehicle, to)
        path = out if out is not None else Path(file)
        texts = {path: text}
        if os.path.lexists(path):
            raise WouldOverwrite(str(path))
        make_folder(path.parent)
    for path, text in texts.items():
        replace_text(path, text)
    return tuple(texts)


def file_for(vehicle: Vehicle, to: str) -> tuple[str, str]:
    """Return name and content of the file of one target."""
    target = find_target(to)
    return _file(target, vehicle), target.text(vehicle)


def _file(target: Target, vehicle: Vehicle) -> str:
    return target.file.format(name=vehicle.name)
