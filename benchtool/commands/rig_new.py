"""`benchtool library rigs new`: a rig file with what its use needs, and nothing assumed."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from math import ceil
from pathlib import Path
from typing import Annotated, Any, Literal

from annotated_types import Ge, Gt, Le

from benchtool.commands.input_commands import command_from_inputs
from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.inputs import Input, Inputs, items

Purpose = Literal["fit", "motor", "sweep", "pitch"]

Length = Annotated[float, Gt(0.0), Le(100.0)]
Pulse = Annotated[float, Gt(0.0), Le(20_000.0)]


@dataclass(frozen=True, slots=True, kw_only=True)
class NewRigInputs(Inputs):
    """Options of `benchtool library rigs new`; required values that are missing are asked."""

    file: Annotated[Path, Input("File to write, such as mine.toml.", argument="FILE")]
    purpose: Annotated[
        Purpose,
        Input(
            "What for: fit tables, test motors without a plate, sweep a plate, a beam on a hinge.",
            option="for",
        ),
    ] = "fit"
    like: Annotated[
        str, Input("Rig (name or file) whose numbers are taken where none is given.")
    ] = ""
    radius: Annotated[
        Length | None, Input("Rotor radius.", "m", default_text="the propeller's, or asked")
    ] = None
    propeller: Annotated[
        str, Input("Propeller: name (benchtool library propellers), file, or inches: 10x4.5.")
    ] = ""
    rotors: Annotated[int, Ge(1), Le(16), Input("How many rotors, evenly around the centre.")] = 1
    arm: Annotated[
        Length | None, Input("Centre to each rotor's axis.", "m", default_text="asked of several")
    ] = None
    cell: Annotated[
        Annotated[float, Gt(0.0), Le(1e5)] | None,
        Input("Rating of the load cell.", "N", default_text="asked for motor, sweep"),
    ] = None
    pulses: Annotated[
        tuple[Pulse, Pulse, Pulse] | None,
        Input(
            "Pulses at which the motor stands, starts, and ends.",
            "us",
            default_text="asked for motor, sweep",
        ),
    ] = None
    current: Annotated[
        Annotated[float, Gt(0.0), Le(1e4)] | None,
        Input(
            "Largest current of the supply; a run stops beyond it.", "A", default_text="no limit"
        ),
    ] = None
    plate: Annotated[
        Literal["device", "grbl", "hand"] | None,
        Input("Who moves the plate.", default_text="asked for a sweep"),
    ] = None
    travel: Annotated[
        tuple[Length, Length] | None,
        Input("Nearest and farthest plate.", "m", default_text="asked for a sweep"),
    ] = None
    inertia: Annotated[
        Annotated[float, Gt(0.0), Le(1e4)] | None,
        Input("Inertia of the beam about its hinge.", "kg m2", default_text="asked for pitch"),
    ] = None
    source: Annotated[str, Input("Where the numbers come from.")] = "stated by the bench's owner"


@command_from_inputs(NewRigInputs)
def new_rig(inputs: NewRigInputs) -> None:
    """Create a rig file; asks for missing values."""
    from benchtool.commands.terminal.messages import write_new
    from benchtool.core.errors import WouldOverwrite
    from benchtool.core.rig_file import parse_rig

    file = inputs.file if inputs.file.suffix == ".toml" else Path(f"{inputs.file}.toml")
    if file.exists():
        raise WouldOverwrite(str(file))
    text = rig_text(inputs, file.stem)
    rig = parse_rig(text, str(file))
    write_new(file, lambda: file.write_text(text, encoding="utf-8"), "another FILE")
    left_out = len(rig.not_stated)
    print(
        f"written: {file}; it leaves out {left_out} numbers, for which typical ones stand in where "
        f"something needs them"
    )
    name = shlex.quote(str(file))
    print(f"# see them\nbenchtool library rigs {name}")
    if inputs.purpose == "pitch":
        print(f"# simulate it\nbenchtool simulate pitch --rig {name} --model pitch_beam")
        return
    if inputs.purpose == "motor":
        print("# try a test without a plate on a virtual bench of this rig")
        print(f"benchtool sweep sim:{name} --plan steps --yes")
        return
    print("# try a sweep on a virtual bench of this rig")
    nearest, farthest = (
        at_m / rig.propulsion.radius_m for at_m in (rig.plate.z_min_m, rig.plate.z_max_m)
    )
    low = max(0.6, ceil(10.0 * nearest) / 10.0)
    places = [f"{low * times:g}" for times in (1.0, 1.5, 3.0) if low * times <= farthest]
    distances = ",".join(places)
    print(f"benchtool sweep sim:{name} --z-over-r {distances} --pwm 1500 --repeats 2 --yes")


def rig_text(inputs: NewRigInputs, name: str) -> str:
    """Return the file of a rig, what is missing asked.

    Raises:
        InputError: something is missing and nobody is at a terminal, or an answer is no number.
    """
    import tomli_w

    from benchtool.core.library import read_named
    from benchtool.core.parsed_text import parse_toml

    known = {item.key: item for item in items(NewRigInputs)}
    data = parse_toml(*read_named("rig", "rigs", inputs.like)) if inputs.like else {}
    data |= {"name": name, "title": name}
    sweeps, tilts, source = inputs.purpose == "sweep", inputs.purpose == "pitch", inputs.source

    def table(key: str) -> dict[str, Any]:
        made: dict[str, Any] = data.setdefault(key, {"source": source})
        return made

    def state(key: str, **numbers: float) -> None:
        for one, value in numbers.items():
            table(key)[one] = {"value": value, "source": source} if inputs.like else value

    def asked(key: str, usual: str = "") -> Any:
        if (value := getattr(inputs, key)) is not None:
            return value
        item = known[key]
        reason = f"{item.option} is missing ({item.label[:1].lower()}{item.label[1:]})"
        typed = ask(item.label, item.option, usual, item.choices, reason)
        return item.read(typed, item.option)

    def missing(key: str, *where: str) -> bool:
        """Return whether a number is to be stated: given, or not in the file that is like it."""
        return getattr(inputs, key) is not None or where[1] not in data.get(where[0], {})

    if inputs.propeller:
        _mount(inputs.propeller, data)
        if inputs.radius is None:
            state("propulsion", radius_m=data["propeller"]["diameter_m"] / 2.0)
    if missing("radius", "propulsion", "radius_m"):
        state("propulsion", radius_m=asked("radius"))
    if tilts and (inputs.arm is not None or "rotors" not in data):
        # Rotor 1 behind the hinge: positive pitch lifts it off the plate.
        data["rotors"] = _rotors([(side * asked("arm"), 0.0) for side in (-1.0, 1.0)], source)
    elif not tilts and inputs.rotors > 1:
        data["rotors"] = _places(inputs.rotors, asked("arm"), source)
    if tilts and missing("inertia", "body", "inertia_yy_kgm2"):
        state("body", inertia_yy_kgm2=asked("inertia"))
    turns = sweeps or inputs.purpose == "motor"
    if (turns or inputs.cell is not None) and missing("cell", "limits", "load_cell_rating_N"):
        state("limits", load_cell_rating_N=asked("cell"))
    if inputs.current is not None:
        state("limits", current_A=inputs.current)
    if (turns or inputs.pulses is not None) and missing("pulses", "propulsion", "pwm_stop_us"):
        stop_us, start_us, max_us = asked("pulses", "1000,1050,1950")
        state("propulsion", pwm_stop_us=stop_us, pwm_start_us=start_us, pwm_max_us=max_us)
    if (sweeps or inputs.plate is not None) and missing("plate", "plate", "moved_by"):
        table("plate")["moved_by"] = asked("plate", "device")
    if (sweeps or inputs.travel is not None) and missing("travel", "plate", "z_min_m"):
        nearest, farthest = asked("travel")
        if not 0.0 < nearest < farthest:
            raise InputError(
                f"--travel is {nearest:g},{farthest:g} m: the nearest plate must stand before the "
                f"farthest, both above 0; give --travel NEAREST,FARTHEST"
            )
        state("plate", z_min_m=nearest, z_max_m=farthest)
    return tomli_w.dumps(data)


def ask(question: str, option: str, usual: str, choices: Sequence[str], reason: str) -> str:
    """Return a line typed on a terminal, again until it is one of the choices.

    Raises:
        InputError: there is no terminal, or the input ended.
    """
    if not sys.stdin.isatty():
        raise InputError(f"{reason}; give {option}")
    offered = f" ({', '.join(choices)})" if choices else ""
    end = f" [{usual}]: " if usual else ": "
    while True:
        print(f"{question}?{offered}{end}", end="", flush=True)
        if not (line := sys.stdin.readline()):
            raise InputError(f"the input has ended; give {option}")
        typed = line.strip() or usual
        if typed and (not choices or typed in choices):
            return typed
        if typed:
            print(UnknownChoice("answer", typed, choices))


def _mount(named: str, data: dict[str, Any]) -> None:
    """Put a propeller into the tables of a rig; coefficients of another one go."""
    from benchtool.data.propeller_file import load_propeller

    numbers = asdict(load_propeller(named))
    stated = {key: value for key, value in numbers.items() if value}
    data["propeller"] = {"source": f"propeller {named}", **stated}
    for key in ("radius_m", "thrust_coefficient_N_s2", "drag_coefficient_Nm_s2"):
        data.get("propulsion", {}).pop(key, None)


def _places(count: int, arm_m: float, source: str) -> list[dict[str, Any]]:
    """Return rotors evenly around the centre, the first ahead and to the left, turning in turn."""
    from math import cos, pi, sin

    angles = [2.0 * pi * (index + 0.5) / count for index in range(count)]
    return _rotors([(arm_m * cos(angle), arm_m * sin(angle)) for angle in angles], source)


def _rotors(places_m: Sequence[tuple[float, float]], source: str) -> list[dict[str, Any]]:
    return [
        {
            "name": f"rotor {index}",
            "x_m": {"value": round(x_m, 6), "source": source},
            "y_m": {"value": round(y_m, 6), "source": source},
            "spin": {"value": 1 if index % 2 else -1, "source": source},
        }
        for index, (x_m, y_m) in enumerate(places_m, 1)
    ]
