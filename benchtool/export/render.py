"""Templates of Gazebo, MuJoCo, rotorpy and the C header, filled with a vehicle's values.

Axes are forward, left, up, as in the rigs. Unmeasured quantities (rotor drag, rolling moment,
flapping) are 0, with a comment. MuJoCo: the control of an actuator is its fraction of full thrust,
0 to 1, with the lag of rising thrust; fraction = (1 - e) u + e u^2.
"""

from __future__ import annotations

from collections.abc import Iterable
from importlib.resources import files
from xml.sax.saxutils import escape

from jinja2 import Environment, FunctionLoader, StrictUndefined

from benchtool.export.vehicle import ExportedNumber, Vehicle

VALUES = {
    "Number": ExportedNumber,
    "not_measured": "not measured; 0: none",
    # Gazebo needs a mass of each rotor link: 0.1 % of the body, which is reduced by it.
    "rotor_mass_share": 1e-3,  # assumed
}


def render(template: str, vehicle: Vehicle, **values: object) -> str:
    """Return a template of `templates/` with the values filled in."""
    folder = files("benchtool.export") / "templates"
    environment = Environment(
        loader=FunctionLoader(lambda name: (folder / name).read_text("utf-8")),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "g": lambda value: f"{value:.9g}",
        "xml_comment": _xml_comment,
        "c_float": _c_float,
        "c_floats": _c_floats,
        "plain": lambda text: text.replace("*/", "* /").replace("\n", " "),  # in a C comment
    }
    return environment.get_template(f"{template}.jinja").render(
        VALUES | values, v=vehicle, rig=vehicle.rig
    )


def _xml_comment(number: ExportedNumber, name: str) -> str:
    # A double hyphen would end the comment.
    return f"<!-- {escape(f'{name} {number.note}').replace('--', '- -')} -->"


def _c_float(value: float) -> str:
    text = f"{value:.9g}"
    return f"{text}f" if any(c in text for c in ".en") else f"{text}.0f"


def _c_floats(values: Iterable[float]) -> str:
    return f"{{{', '.join(map(_c_float, values))}}}"
