"""The targets of `benchtool export`: templates filled with a vehicle's values.

Axes are forward, left, up, as in the rigs. Unmeasured quantities (rotor drag, rolling moment,
flapping) are 0, with a comment.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from xml.sax.saxutils import escape

from jinja2 import Environment, FunctionLoader, StrictUndefined

from benchtool import __version__
from benchtool.core.errors import UnknownChoice, WouldOverwrite
from benchtool.data.atomic import make_folder, replace_text
from benchtool.export.autopilots import ardupilot, betaflight, px4
from benchtool.export.c_header import c_header
from benchtool.export.vehicle import ExportedNumber, Vehicle


@dataclass(frozen=True, slots=True)
class Target:
    """Export target.

    Attributes:
        file: file name, with "{name}" for the rig name.
        template: name of the file in `templates/`.
        values: returns what the template needs beside the vehicle.
        comment: format of a comment line.
    """

    title: str
    file: str
    template: str
    values: Callable[[Vehicle], Mapping[str, object]] = lambda vehicle: {}
    comment: str = "# {}"

    def text(self, vehicle: Vehicle) -> str:
        """Return the content of the file, with its source in the first comment lines."""
        lines = [f"rig {vehicle.rig.name}, model {vehicle.model.name}; benchtool {__version__}"]
        if vehicle.simulated:
            lines.append("SIMULATED: the data of the fit or motor test are from a virtual bench")
        header = "\n".join(self.comment.format(line) for line in lines)
        template = _environment().get_template(f"{self.template}.jinja")
        body = template.render(self.values(vehicle), v=vehicle, rig=vehicle.rig).rstrip("\n")
        if body.startswith("<?xml"):
            declaration, _, content = body.partition("\n")
            return f"{declaration}\n{header}\n{content}\n"
        return f"{header}\n{body}\n"


XML = "<!-- {} -->"

TARGETS: Mapping[str, Target] = {  # values of `benchtool export --to`
    "sdf": Target("Gazebo: SDF with MulticopterMotorModel", "{name}.sdf", "sdf", comment=XML),
    "mujoco": Target("MuJoCo: MJCF with thrust actuators", "{name}.xml", "mujoco", comment=XML),
    "rotorpy": Target("rotorpy: a module with quad_params", "{name}_params.py", "rotorpy"),
    "ardupilot": Target("ArduPilot: MOT_* parameters", "{name}.param", "ardupilot", ardupilot),
    "px4": Target("PX4: CA_ROTOR*, THR_MDL_FAC", "{name}.params", "px4", px4),
    "betaflight": Target("Betaflight: thrust_linear", "{name}.cli.txt", "betaflight", betaflight),
    "c": Target(
        "C header: thrust and throttle near a surface", "{name}.h", "c", c_header, "/* {} */"
    ),
}


def write_targets(vehicle: Vehicle, to: str, out: Path | None = None) -> tuple[Path, ...]:
    """Write the file of a target, or a folder for "all"; return the paths.

    Args:
        out: new file, or new folder for "all"; default: named after the rig.

    Raises:
        UnknownChoice: unknown target.
        InputError: the target cannot represent the model.
        WouldOverwrite: the path exists.
    """
    texts = dict(file_for(vehicle, name) for name in (TARGETS if to == "all" else [to]))
    if to == "all":
        new = folder = out or Path(f"{vehicle.name}-export")
        paths = [folder / file for file in texts]
    else:
        new = out or Path(*texts)
        folder, paths = new.parent, [new]
    if os.path.lexists(new):
        raise WouldOverwrite(str(new))
    make_folder(folder)
    for path, text in zip(paths, texts.values(), strict=True):
        replace_text(path, text)
    return tuple(paths)


def file_for(vehicle: Vehicle, to: str) -> tuple[str, str]:
    """Return name and content of the file of one target."""
    if to not in TARGETS:
        raise UnknownChoice("target", to, (*TARGETS, "all"))
    return TARGETS[to].file.format(name=vehicle.name), TARGETS[to].text(vehicle)


@cache
def _environment() -> Environment:
    folder = files("benchtool.export") / "templates"
    environment = Environment(
        loader=FunctionLoader(lambda name: (folder / name).read_text("utf-8")),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals["Number"] = ExportedNumber
    environment.filters |= {
        "g": lambda value: f"{value:.9g}",
        "xml_comment": _xml_comment,
        "c_float": _c_float,
        "c_floats": _c_floats,
        "plain": lambda text: text.replace("*/", "* /").replace("\n", " "),  # in a C comment
        "omitted": _omitted,
    }
    return environment


def _xml_comment(number: ExportedNumber, name: str) -> str:
    # A double hyphen would end the comment.
    return f"<!-- {escape(f'{name} {number.note}').replace('--', '- -')} -->"


def _c_float(value: float) -> str:
    text = f"{value:.9g}"
    return f"{text}f" if any(c in text for c in ".en") else f"{text}.0f"


def _c_floats(values: Iterable[float]) -> str:
    return f"{{{', '.join(map(_c_float, values))}}}"


def _omitted(number: ExportedNumber, name: str) -> str:
    """Return the comment that replaces a value based on a typical number."""
    return f"# {name} omitted, measure it (motor test, --motor) or state it: {number.why}"
