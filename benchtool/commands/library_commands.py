"""Commands `benchtool library rigs`, `propellers`, `models` and `effects`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Annotated

from benchtool.commands.input_commands import command_from_inputs
from benchtool.commands.terminal.messages import announce_code
from benchtool.core.inputs import Input, Inputs


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
    from benchtool.core.errors import BenchtoolError
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
