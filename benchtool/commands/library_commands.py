"""Commands `benchtool library rigs`, `rigs new`, `propellers`, `models` and `effects`."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from math import ceil, cos, pi, sin
from pathlib import Path
from typing import Annotated, Any, Literal

from annotated_types import Ge, Gt, Le

from benchtool.commands.input_commands import command_from_inputs
from benchtool.commands.terminal.messages import announce_code, write_new
from benchtool.core.choices import PlateMover
from benchtool.core.errors import BenchtoolError, InputError, UnknownChoice, WouldOverwrite
from benchtool.core.inputs import Input, InputField, Inputs, items


@dataclass(frozen=True, slots=True, kw_only=True)
class LibraryInputs(Inputs):
    """Options of `benchtool library rigs`, `propellers` and `models`."""

    name: Annotated[
        str, Input("Name or file to show.", argument="NAME", default_text="list all")
    ] = ""
    toml: Annotated[bool, Input("Print the TOML text.")] = False


@command_from_inputs(LibraryInputs)
def models(inputs: LibraryInputs) -> None:
    """List models, or show one with its effects and parameters."""
    from benchtool.physics.model_file import load_model

    if inputs.name:
        _show("model", inputs, _describe_model(inputs.name))
    else:
        _list("models", lambda name: load_model(name).model.description)


@command_from_inputs(LibraryInputs)
def rigs(inputs: LibraryInputs) -> None:
    """List rigs, or show one with all values and sources.

    `benchtool library rigs new` creates a rig file.
    """
    from benchtool.core.rig_file import load_rig_by_name

    if inputs.name:
        _show("rig", inputs, _describe_rig(inputs.name))
    else:
        _list("rigs", lambda name: load_rig_by_name(name).title, has_user_files=True)


@command_from_inputs(LibraryInputs)
def propellers(inputs: LibraryInputs) -> None:
    """List propellers, or show one with all values and sources."""
    from benchtool.data.propeller_file import read_propeller

    if inputs.name:
        propeller, sources = read_propeller(inputs.name)
        lines = [f"{propeller.name}: {propeller.title}"]
        for key, source in sources.items():
            lines.append(f"  {key:<12} {_format_value(propeller, key):>10}  {source}")
        _show("propeller", inputs, lines)
    else:
        _list("propellers", lambda name: read_propeller(name)[0].title, has_user_files=True)


def _show(kind: str, inputs: LibraryInputs, lines: Iterable[str]) -> None:
    """Print the lines that describe one entry, or its TOML text."""
    from benchtool.core.user_file import read_library_file

    text = "".join(f"{line}\n" for line in lines)
    print(read_library_file(kind, f"{kind}s", inputs.name)[0] if inputs.toml else text, end="")


def _list(folder: str, title: Callable[[str], str], *, has_user_files: bool = False) -> None:
    """Print one line per entry of the library; user's files that are invalid with their error."""
    from benchtool.core.user_file import list_names, user_library_folder, user_names

    for name in list_names(folder):
        print(f"{name:<16} {title(name)}")
    if not has_user_files:
        return
    names = user_names(folder)
    print(f"user library, {user_library_folder() / folder}:{'' if names else ' none'}")
    for name in names:
        try:
            print(f"{name:<16} {title(name)}")
        except BenchtoolError as error:
            print(f"{name:<14} cannot be read: {error}")


def _describe_model(name: str) -> Iterator[str]:
    from benchtool.physics.model_file import load_model

    model = load_model(name, permit=announce_code).model
    yield f"{model.name}: {model.description}"
    rules = f"wake rule {model.wake_rule}, tilt rule {model.tilt_rule}"
    yield f"rig {model.rig.name}, {rules}, b is the {model.body_distance}"
    yield f"effects: {', '.join(effect.name for effect in model.effects) or 'none'}"
    for name, parameter in model.parameters.items():
        state = "free " if parameter.free else "fixed"
        bounds = f"[{parameter.lower:g}, {parameter.upper:g}]"
        value = f"{parameter.value:>12g} {parameter.unit:<14}"
        yield f"  {name:<26} {value} {state} {bounds:<18} {parameter.source}"


def _describe_rig(name: str) -> Iterator[str]:
    from benchtool.core.rig import UNSPECIFIED
    from benchtool.core.rig_file import load_rig_by_name

    rig = load_rig_by_name(name)
    yield f"{rig.name}: {rig.title}"
    sources = {key: source for key, source in rig.sources.items() if key not in rig.not_stated}
    n_assumed = len(rig.assumed) or "none"
    yield f"{n_assumed} of {len(sources)} numbers are assumed (marked ?)"
    for key, source in sources.items():
        mark = "?" if key in rig.assumed else " "
        yield f"{mark} {key:<40} {_format_value(rig, key):>12}  {source}"
    if rig.not_stated:
        yield "not in the file; typical values are used:"
    for key in sorted(rig.not_stated, key=list(rig.sources).index):
        source = rig.sources[key].removeprefix(UNSPECIFIED)[2:]
        yield f"  {key:<40} {_format_value(rig, key):>12}  {source}"


def _format_value(rig: object, key: str) -> str:
    """Return the value at a dotted key such as `rotors[0].x_m`, as text."""
    value: object = rig
    for part in key.replace("[", ".[").split("."):
        if part.startswith("["):
            value = value[int(part[1:-1])]  # type: ignore[index]
        elif isinstance(value, dict):
            value = value[part]
        else:
            value = getattr(value, part)
    return f"{value:g}" if isinstance(value, int | float) else str(value)


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectsInputs(Inputs):
    """Options of `benchtool library effects`."""

    name: Annotated[str, Input("Effect to show.", argument="NAME", default_text="list all")] = ""
    rig: Annotated[str, Input("Rig name or file for the tolerances.")] = "beam"


@command_from_inputs(EffectsInputs)
def effects(inputs: EffectsInputs) -> None:
    """List physical effects, or show one with law and parameters."""
    from benchtool.core.rig_file import load_rig_by_name
    from benchtool.physics.catalogue import EFFECTS, find_effect
    from benchtool.physics.effects.effect import BENCH_KINDS
    from benchtool.physics.tolerances import default_tolerances

    if not inputs.name:
        for effect in EFFECTS.values():
            print(f"{effect.name:<18} {effect.subsystem:<14} {effect.title}: {effect.law}")
        return
    effect, rig = find_effect(inputs.name), load_rig_by_name(inputs.rig)
    print(f"{effect.name}: {effect.title} ({effect.subsystem})")
    print(effect.description)
    print(f"law:    {effect.law}")
    print(f"shows:  {effect.shows}")
    print(f"source: {effect.source}")
    if (law := effect.distance_law) is not None:
        values = {parameter.name: parameter.value for parameter in effect.parameters}
        pole = "none" if law.singular is None else f"z/R {law.singular(values):.3g}"
        print(f"basis:  {law.basis}; pole: {pole}; limit far away: {law.far}")
        print(f"tested: {law.tested}; seen: {law.seen}")
        if law.same_as:
            print(f"equivalent to {law.same_as}, with another parameter")
    for other, reason in effect.confused_with.items():
        print(f"similar to {other}: {reason}")
    benches = [bench for bench in BENCH_KINDS if bench in effect.benches]
    print(f"candidate on: {' and '.join(f'{bench} benches' for bench in benches) or 'no bench'}")
    tolerances = {
        bench: default_tolerances(effect, rig, bench) for bench in benches or BENCH_KINDS[:1]
    }
    for parameter in effect.parameters:
        name, neutral = parameter.name, "no neutral value"
        if parameter.neutral is not None:
            neutral = f"neutral {parameter.neutral:g}"
        texts = [
            f"{by_name[name]:.3g} ({bench})"
            for bench, by_name in tolerances.items()
            if name in by_name
        ]
        tolerance = f"; tolerance on {inputs.rig}: {', '.join(texts)}" if texts else ""
        print(f"  {name} [{parameter.unit}]: {parameter.description}; {neutral}{tolerance}")


Purpose = Literal["fit", "motor", "sweep", "pitch"]

Length = Annotated[float, Gt(0.0), Le(100.0)]
Pulse = Annotated[float, Gt(0.0), Le(20_000.0)]


@dataclass(frozen=True, slots=True, kw_only=True)
class NewRigInputs(Inputs):
    """Options of `benchtool library rigs new`; prompts for missing required values."""

    file: Annotated[Path, Input("New file, e.g. mine.toml.", argument="FILE")]
    purpose: Annotated[
        Purpose,
        Input("Purpose: fit of tables, motor test, plate sweep, or pitch bench.", option="for"),
    ] = "fit"
    like: Annotated[str, Input("Rig name or file to copy other values from.")] = ""
    radius: Annotated[
        Length | None, Input("Rotor radius.", "m", default_text="from propeller or prompt")
    ] = None
    propeller: Annotated[
        str, Input("Propeller: name (benchtool library propellers), file, or inches: 10x4.5.")
    ] = ""
    rotors: Annotated[int, Ge(1), Le(16), Input("Number of rotors, evenly spaced on a circle.")] = 1
    arm: Annotated[
        Length | None, Input("Radius of the rotor circle.", "m", default_text="prompt")
    ] = None
    cell: Annotated[
        Annotated[float, Gt(0.0), Le(1e5)] | None,
        Input("Load cell rating.", "N", default_text="prompt for motor, sweep"),
    ] = None
    pulses: Annotated[
        tuple[Pulse, Pulse, Pulse] | None,
        Input("Pulse widths at stop, start and maximum.", "us", default_text="as for --cell"),
    ] = None
    current: Annotated[
        Annotated[float, Gt(0.0), Le(1e4)] | None,
        Input("Current limit; a run stops above it.", "A", default_text="no limit"),
    ] = None
    plate: Annotated[
        PlateMover | None,
        Input("Plate stage.", default_text="prompt for sweep"),
    ] = None
    travel: Annotated[
        tuple[Length, Length] | None,
        Input("Minimum and maximum plate distance.", "m", default_text="prompt for sweep"),
    ] = None
    inertia: Annotated[
        Annotated[float, Gt(0.0), Le(1e4)] | None,
        Input("Beam inertia about the hinge.", "kg m2", default_text="prompt for pitch"),
    ] = None
    source: Annotated[str, Input("Source of the values.")] = "stated by the bench's owner"


@command_from_inputs(NewRigInputs)
def new_rig(inputs: NewRigInputs) -> None:
    """Create a rig file, with prompts for missing values."""
    from benchtool.core.rig_file import parse_rig

    file = inputs.file if inputs.file.suffix == ".toml" else Path(f"{inputs.file}.toml")
    if file.exists():
        raise WouldOverwrite(str(file))
    text = rig_text(inputs, file.stem)
    rig = parse_rig(text, str(file))
    write_new(file, lambda: file.write_text(text, encoding="utf-8"), "another FILE")
    print(f"written: {file}; typical values are assumed for {len(rig.not_stated)} other numbers")
    name = shlex.quote(str(file))
    print(f"# show all values\nbenchtool library rigs {name}")
    if inputs.purpose == "pitch":
        print(f"# simulate it\nbenchtool simulate pitch --rig {name} --model pitch_beam")
        return
    if inputs.purpose == "motor":
        print("# run a test without a plate on a virtual bench of this rig")
        print(f"benchtool sweep sim:{name} --plan steps --yes")
        return
    print("# run a sweep on a virtual bench of this rig")
    nearest, farthest = (
        z_m / rig.propulsion.radius_m for z_m in (rig.plate.z_min_m, rig.plate.z_max_m)
    )
    first = max(0.6, ceil(10.0 * nearest) / 10.0)
    z_over_R = [first * factor for factor in (1.0, 1.5, 3.0)]
    distances = ",".join(f"{ratio:g}" for ratio in z_over_R if ratio <= farthest)
    print(f"benchtool sweep sim:{name} --z-over-r {distances} --pwm 1500 --repeats 2 --yes")


VALUES = {  # by option: table and keys of the file, and purposes that need it
    "radius": ("propulsion", "radius_m", "fit motor sweep pitch"),
    "inertia": ("body", "inertia_yy_kgm2", "pitch"),
    "cell": ("limits", "load_cell_rating_N", "motor sweep"),
    "current": ("limits", "current_A", ""),
    "pulses": ("propulsion", "pwm_stop_us pwm_start_us pwm_max_us", "motor sweep"),
    "plate": ("plate", "moved_by", "sweep"),
    "travel": ("plate", "z_min_m z_max_m", "sweep"),
}
PROMPT_DEFAULTS = {"pulses": "1000,1050,1950", "plate": "device"}


def rig_text(inputs: NewRigInputs, name: str) -> str:
    """Return the text of the rig file; prompts for missing values.

    Raises:
        InputError: a value is missing and there is no terminal, or an answer is not a number.
    """
    import tomli_w

    from benchtool.core.toml_text import parse_toml
    from benchtool.core.user_file import read_library_file

    fields = {item.key: item for item in items(NewRigInputs)}
    data = parse_toml(*read_library_file("rig", "rigs", inputs.like)) if inputs.like else {}
    data |= {"name": name, "title": name}
    source = inputs.source

    def get(key: str) -> Any:
        if (value := getattr(inputs, key)) is not None:
            return value
        item = fields[key]
        text = ask(item, PROMPT_DEFAULTS.get(key, ""))
        return item.read(text, item.option)

    def write_option(option: str) -> None:
        table, keys, purposes = VALUES[option]
        is_missing = keys.split()[0] not in data.get(table, {})
        if getattr(inputs, option) is None and not (is_missing and inputs.purpose in purposes):
            return
        value = get(option)
        values = value if isinstance(value, tuple) else (value,)
        if option == "travel" and not 0.0 < values[0] < values[1]:
            raise InputError(
                f"--travel {values[0]:g},{values[1]:g} m is invalid; give --travel MIN,MAX with "
                f"0 < MIN < MAX"
            )
        for key, item in zip(keys.split(), values, strict=True):
            has_source = inputs.like and not isinstance(item, str)
            data.setdefault(table, {"source": source})[key] = (
                {"value": item, "source": source} if has_source else item
            )

    if inputs.propeller:
        _set_propeller(inputs.propeller, data)
        if inputs.radius is None:
            inputs = replace(inputs, radius=data["propeller"]["diameter_m"] / 2.0)
    write_option("radius")
    if inputs.purpose == "pitch":
        if inputs.arm is not None or "rotors" not in data:
            # Rotor 1 is behind the hinge: positive pitch moves it away from the plate.
            data["rotors"] = _rotors([(side * get("arm"), 0.0) for side in (-1.0, 1.0)], source)
        write_option("inertia")
    elif inputs.rotors > 1:
        # Evenly spaced on a circle, first front left, with alternating spin.
        arm_m, count = get("arm"), inputs.rotors
        angles = [2.0 * pi * (index + 0.5) / count for index in range(count)]
        circle_m = [(arm_m * cos(angle), arm_m * sin(angle)) for angle in angles]
        data["rotors"] = _rotors(circle_m, source)
    for option in ("cell", "current", "pulses", "plate", "travel"):
        write_option(option)
    return tomli_w.dumps(data)


def ask(item: InputField, default: str) -> str:
    """Prompt on a terminal until the answer is one of the choices, and return it.

    Raises:
        InputError: no terminal, or end of input.
    """
    if not sys.stdin.isatty():
        label = f"{item.label[:1].lower()}{item.label[1:]}"
        raise InputError(f"{item.option} is missing ({label}); give {item.option}")
    choice_text = f" ({', '.join(item.choices)})" if item.choices else ""
    end = f" [{default}]: " if default else ": "
    while True:
        print(f"{item.label}?{choice_text}{end}", end="", flush=True)
        if not (line := sys.stdin.readline()):
            raise InputError(f"end of input; give {item.option}")
        answer = line.strip() or default
        if answer and (not item.choices or answer in item.choices):
            return answer
        if answer:
            print(UnknownChoice("answer", answer, item.choices))


def _set_propeller(name: str, data: dict[str, Any]) -> None:
    """Write a propeller to the tables of a rig and remove coefficients of the previous one."""
    from benchtool.data.propeller_file import load_propeller

    fields = asdict(load_propeller(name))
    values = {key: value for key, value in fields.items() if value}
    data["propeller"] = {"source": f"propeller {name}", **values}
    for key in ("radius_m", "thrust_coefficient_N_s2", "drag_coefficient_Nm_s2"):
        data.get("propulsion", {}).pop(key, None)


def _rotors(positions_m: Sequence[tuple[float, float]], source: str) -> list[dict[str, Any]]:
    return [
        {
            "name": f"rotor {index}",
            "x_m": {"value": round(x_m, 6), "source": source},
            "y_m": {"value": round(y_m, 6), "source": source},
            "spin": {"value": 1 if index % 2 else -1, "source": source},
        }
        for index, (x_m, y_m) in enumerate(positions_m, 1)
    ]
