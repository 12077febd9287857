"""The targets of `benchtool export`: templates filled with a vehicle's values.

Axes are forward, left, up, as in the rigs. Unmeasured quantities (rotor drag, rolling moment,
flapping) are 0, with a comment.

Autopilots map a demand d, 0 at the idle pulse and 1 at the maximum pulse, to a throttle. ArduPilot
(MOT_THST_EXPO) and PX4 (THR_MDL_FAC) command the v of d = (1 - e) v + e v^2. Betaflight
(thrust_linear, t in percent over 100) commands d (1 + t (1 - d) (1 + t (1 - 2 d))) since 2026.6,
and d (1 + t (1 - d)^2) in 4.3 to 2025.12. The parameter minimises the variation of the gain dT/dd,
the criterion of ArduPilot's ThrustExpo tool.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np
from jinja2 import Environment, FunctionLoader, StrictUndefined
from numpy.polynomial import chebyshev

from benchtool import __version__
from benchtool.core.errors import InputError, UnknownChoice, WouldOverwrite
from benchtool.core.rig import UNSPECIFIED
from benchtool.core.units import Array
from benchtool.data.atomic import make_folder, replace_text
from benchtool.export.vehicle import ExportedNumber, Vehicle

DEFAULT_IDLE_SHARE = 0.1  # idle throttle: 1 % of full thrust for a square law; assumed
MAX_THRUST_LINEAR = 150  # of Betaflight, in percent
DEMANDS = np.linspace(0.0, 1.0, 1001)  # step of ArduPilot's ThrustExpo tool
EXPO_STEP = 0.005  # of the same tool
MAX_USUAL_EXPO = 0.75  # maximum in ArduPilot's page "Setting the Aircraft Up for Tuning"

ARDUPILOT = (
    "linearised as AP_Motors_Thrust_Linearization.cpp of ArduPilot 04dc0b71 does, by the criterion "
    "of WebTools/ThrustExpo 18e89bc0"
)
CAUTION = (
    f"CAUTION: above {MAX_USUAL_EXPO}, ArduPilot's value for propellers of 20 inches and larger; "
    "check that mid throttle is linear, rather than a perfect fit at the ends"
)
PX4 = "linearised as mixer_module/functions/FunctionMotors.hpp of PX4 15c4f088 does"


def expo_throttle(expo: float, demand: Array) -> Array:
    """Return the throttle command of ArduPilot and PX4, 0 (idle) to 1 (full)."""
    if expo == 0.0:
        return demand
    root = np.sqrt((1.0 - expo) ** 2 + 4.0 * expo * demand)
    return np.asarray((root + expo - 1.0) / (2.0 * expo), float)


def betaflight_throttle(share: float, demand: Array) -> Array:
    """Return the throttle command of Betaflight 2026.6."""
    margin = 1.0 - demand
    return np.asarray(demand * (1.0 + share * margin * (1.0 + share * (margin - demand))), float)


def cubic_throttle(share: float, demand: Array) -> Array:
    """Return the throttle command of Betaflight 4.3 to 2025.12."""
    return np.asarray(demand * (1.0 + share * (1.0 - demand) ** 2), float)


def most_linear(
    vehicle: Vehicle, throttle: Callable[[float, Array], Array], settings: Array
) -> tuple[float, str]:
    """Return the setting with the smallest variation of the gain, and a description of it."""
    scores = []
    for setting in settings.tolist():
        command = DEFAULT_IDLE_SHARE + (1.0 - DEFAULT_IDLE_SHARE) * np.clip(
            throttle(setting, DEMANDS), 0.0, 1.0
        )
        gain = np.diff(vehicle.thrust_N(command))
        scores.append((float(gain.std() / gain.mean()), setting, float(gain.max() / gain.min())))
    relative_sd, best, ratio = min(scores)
    text = f"sd {100.0 * relative_sd:.2g} %, largest over smallest {ratio:.3g}"
    return best, f"gain dT/d(demand) from idle to full: {text}"


def expo_over_idle(vehicle: Vehicle, low: float, source: str) -> ExportedNumber:
    """Return the expo from `low` to 1 at which thrust is most linear in demand above idle."""
    settings = np.round(np.arange(low, 1.0 + 0.5 * EXPO_STEP, EXPO_STEP), 3)
    value, text = most_linear(vehicle, expo_throttle, settings)
    why = f"{source}; {text}; expo {vehicle.expo.value:.4g} over throttle: {vehicle.expo.why}"
    if vehicle.motor is not None and vehicle.expo.stated:
        e = np.maximum(vehicle.motor["expo"].interval_95, -1.0)  # over throttle
        ends = np.clip(e * (1.0 - DEFAULT_IDLE_SHARE) / (1.0 + e * DEFAULT_IDLE_SHARE), low, 1.0)
        why = f"95 %: {ends[0]:.3g} to {ends[1]:.3g}; {why}"
    why = f"limit of the target; {why}" if value in (low, 1.0) else why
    return ExportedNumber(value, "1", why, vehicle.expo.stated)


def idle_pulse(vehicle: Vehicle) -> ExportedNumber:
    """Return the pulse at `DEFAULT_IDLE_SHARE` of the throttle."""
    start_us = vehicle.rig.propulsion.pwm_start_us
    pulse_us = start_us + DEFAULT_IDLE_SHARE * (vehicle.full[0].value - start_us)
    share = 100.0 * float(vehicle.thrust_N(np.array(DEFAULT_IDLE_SHARE))) / vehicle.thrust_max.value
    return ExportedNumber(
        pulse_us, "us", f"idle, {share:.2g} % of full thrust; assumed, rotors must turn"
    )


def ardupilot(vehicle: Vehicle) -> dict[str, object]:
    """Return the values of a parameter file of ArduCopter."""
    expo = expo_over_idle(vehicle, -1.0, ARDUPILOT)
    if expo.value > MAX_USUAL_EXPO:
        expo = replace(expo, why=f"{CAUTION}; {expo.why}")
    return {"expo": expo, "idle": idle_pulse(vehicle)}


def px4(vehicle: Vehicle) -> dict[str, object]:
    """Return the values of a parameter file of PX4."""
    return {"expo": expo_over_idle(vehicle, 0.0, PX4), "idle": idle_pulse(vehicle)}


def betaflight(vehicle: Vehicle) -> dict[str, object]:
    """Return the values of lines for Betaflight's command line."""
    settings = np.arange(MAX_THRUST_LINEAR + 1, dtype=float) / 100.0
    linear, linear_gain = most_linear(vehicle, betaflight_throttle, settings)
    cubic, cubic_gain = most_linear(vehicle, cubic_throttle, settings)
    gains = {"linear_gain": linear_gain, "cubic_gain": cubic_gain}
    return {"idle": idle_pulse(vehicle), "linear": linear, "cubic": cubic, **gains}


DEGREE = 7  # of the polynomials of the C header
TOLERANCE = 1e-7  # relative error of an interval; float rounding adds a few times 6e-8
MAX_INTERVALS = 128  # 4 kB; assumed


def c_header(vehicle: Vehicle) -> dict[str, object]:
    """Return the values of a C header with the thrust near a surface: float, no heap, no globals.

    The thrust factor is a piecewise polynomial in z_min/z (0 far away, 1 at the minimum distance);
    intervals are halved until the error is within tolerance. Interval ends (n + 1,) are in
    z_min/z; coefficients (n, DEGREE + 1) are of powers of x, -1 to 1 over an interval.

    Raises:
        InputError: the law needs more than `MAX_INTERVALS`.
    """
    nearest_m = vehicle.nearest_z_m
    nodes = np.cos(np.pi * (np.arange(DEGREE + 1) + 0.5) / (DEGREE + 1))
    check = np.linspace(-1.0, 1.0, 33)
    ends, coefficients = [0.0], []
    pending = [(0.0, 1.0)]
    while pending:
        low, high = pending.pop()
        middle, half = 0.5 * (low + high), 0.5 * (high - low)

        def factor(x: Array, middle: float = middle, half: float = half) -> Array:
            s = np.maximum(middle + half * x, 1e-9)
            return vehicle.factor(nearest_m / s)

        series = chebyshev.chebfit(nodes, factor(nodes), DEGREE)
        truth = factor(check)
        if np.abs(chebyshev.chebval(check, series) / truth - 1.0).max() < TOLERANCE:
            ends.append(high)
            coefficients.append(chebyshev.cheb2poly(series))
            continue
        if len(coefficients) + len(pending) + 2 > MAX_INTERVALS:
            raise InputError(
                f"model {vehicle.model.name!r}: {MAX_INTERVALS} polynomials do not fit its law of "
                f"thrust against distance; export a model with a smooth law"
            )
        pending += [(middle, high), (low, middle)]
    padded = [np.pad(c, (0, DEGREE + 1 - len(c))) for c in coefficients]
    return {"ends": np.array(ends), "coefficients": np.array(padded), "degree": DEGREE}


@dataclass(frozen=True, slots=True)
class Target:
    """Export target."""

    title: str
    file: str  # with "{name}" for the rig name
    template: str  # name of the file in `templates/`
    values: Callable[[Vehicle], Mapping[str, object]] = lambda vehicle: {}  # beside the vehicle
    comment: str = "# {}"  # format of a comment line

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
    new = out or Path(f"{vehicle.name}-export" if to == "all" else next(iter(texts)))
    paths = [new / file for file in texts] if to == "all" else [new]
    if os.path.lexists(new):
        raise WouldOverwrite(str(new), out="--out")
    make_folder(paths[0].parent)
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
        "c_floats": lambda values: f"{{{', '.join(map(_c_float, values))}}}",
        "plain": lambda text: text.replace("*/", "* /").replace("\n", " "),  # in a C comment
        "omitted": _omitted,
    }
    return environment


def _xml_comment(number: ExportedNumber, name: str) -> str:  # "--" would end the comment
    return f"<!-- {escape(f'{name} {number.note}').replace('--', '- -')} -->"


def _c_float(value: float) -> str:
    text = f"{value:.9g}"
    return f"{text}f" if any(c in text for c in ".en") else f"{text}.0f"


def _omitted(number: ExportedNumber, name: str) -> str:
    """Return the comment that replaces a value based on a typical number."""
    reason = "no motor test; give one with --motor"
    if "HOVER" in name:
        reason = "the mass of the vehicle is not stated; give --mass-kg and --rotors"
    elif UNSPECIFIED in number.why:
        reason = "the rig does not state it; add it to the rig file (of a log: --rig)"
    return f"# {name} is omitted: {reason}"
