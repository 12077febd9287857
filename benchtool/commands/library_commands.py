"""`benchtool library rigs`, `models` and `effects`: what ships, or one of them in words."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Annotated

from benchtool.commands.input_commands import command_from_inputs
from benchtool.commands.terminal.messages import announce_code
from benchtool.core.inputs import Input, Inputs


@dataclass(frozen=True, slots=True, kw_only=True)
class ShippedInputs(Inputs):
    """What `benchtool library rigs` and `benchtool library models` take."""

    name: Annotated[
        str, Input("A shipped one or the path of a file; all are listed without.", argument="NAME")
    ] = ""
    toml: Annotated[bool, Input("Print the file itself, to start one of your own.")] = False


@command_from_inputs(ShippedInputs)
def models(inputs: ShippedInputs) -> None:
    """List models, or show one with its effects and parameters."""
    _show("model", inputs, listed=_listed_models, described=_described_model)


@command_from_inputs(ShippedInputs)
def rigs(inputs: ShippedInputs) -> None:
    """List rigs, or show one with all values and sources.

    `benchtool library rigs new` writes one of your own.
    """
    _show("rig", inputs, listed=_listed_rigs, described=_described_rig)


@command_from_inputs(ShippedInputs)
def propellers(inputs: ShippedInputs) -> None:
    """List propellers, or show one with all values and sources."""
    _show("propeller", inputs, listed=_listed_propellers, described=_described_propeller)


def _show(
    kind: str,
    inputs: ShippedInputs,
    *,
    listed: Callable[[], Iterable[str]],
    described: Callable[[str], Iterable[str]],
) -> None:
    """Print a list without a name; with one, the file itself or what it says.

    Args:
        listed: gives a line for each that ships.
        described: gives the lines of one; it refuses what is no such file.
    """
    from benchtool.core.library import read_named

    lines = described(inputs.name) if inputs.name else listed()
    if inputs.name and inputs.toml:
        list(lines)  # a file that cannot be used is refused, not printed
        print(read_named(kind, f"{kind}s", inputs.name)[0], end="")
        return
    for line in lines:
        print(line)


def _listed_models() -> Iterator[str]:
    from benchtool.physics.model_file import load_model, model_names

    for name in model_names():
        yield f"{name:<16} {load_model(name).model.description}"


def _described_model(name: str) -> Iterator[str]:
    from benchtool.physics.model_file import load_model

    loaded = load_model(name, permit=announce_code)
    model = loaded.model
    yield f"{model.name}: {model.description}"
    rules = f"wake rule {model.wake_rule}, tilt rule {model.tilt_rule}"
    yield f"rig {model.rig.name}, {rules}, b is the {model.body_distance}"
    effects = ", ".join(effect.name for effect in model.effects) or "none"
    yield f"effects: {effects}"
    for full_name, item in model.parameters.items():
        state = "free " if item.free else "fixed"
        bounds = f"[{item.lower:g}, {item.upper:g}]"
        value = f"{item.value:>12g} {item.unit:<14}"
        yield f"  {full_name:<26} {value} {state} {bounds:<18} {item.source}"


def _listed_rigs() -> Iterator[str]:
    from benchtool.core.rig_file import load_rig_by_name, rig_names

    for name in rig_names():
        yield f"{name:<16} {load_rig_by_name(name).title}"
    yield from _listed_own("rigs", lambda name: load_rig_by_name(name).title)


def _listed_own(folder: str, title: Callable[[str], str]) -> Iterator[str]:
    """Give a line for each file of the user's library, one that is broken with what is wrong."""
    from benchtool.core.errors import BenchtoolError
    from benchtool.core.library import user_library_folder, user_names

    names = user_names(folder)
    yield f"yours, in {user_library_folder() / folder}:{'' if names else ' none'}"
    for name in names:
        try:
            yield f"{name:<16} {title(name)}"
        except BenchtoolError as error:
            yield f"{name:<14} cannot be read: {error}"


def _listed_propellers() -> Iterator[str]:
    from benchtool.core.library import list_names
    from benchtool.data.propeller_file import FOLDER, read_propeller

    for name in list_names(FOLDER):
        yield f"{name:<16} {read_propeller(name)[0].title}"
    yield from _listed_own(FOLDER, lambda name: read_propeller(name)[0].title)


def _described_propeller(name: str) -> Iterator[str]:
    from benchtool.data.propeller_file import read_propeller

    propeller, sources = read_propeller(name)
    yield f"{propeller.name}: {propeller.title}"
    for key, source in sources.items():
        yield f"  {key:<12} {_value(propeller, key):>10}  {source}"


def _described_rig(name: str) -> Iterator[str]:
    from benchtool.core.rig import UNSPECIFIED
    from benchtool.core.rig_file import load_rig_by_name

    rig = load_rig_by_name(name)
    yield f"{rig.name}: {rig.title}"
    stated = {key: source for key, source in rig.sources.items() if key not in rig.not_stated}
    if rig.assumed:
        yield f"{len(rig.assumed)} of {len(stated)} numbers are assumed (marked ?)"
    else:
        yield f"all {len(stated)} numbers are stated"
    for key, source in stated.items():
        mark = "?" if key in rig.assumed else " "
        yield f"{mark} {key:<40} {_value(rig, key):>12}  {source}"
    if rig.not_stated:
        yield "not stated, and typical where something needs it:"
    for key in sorted(rig.not_stated, key=list(rig.sources).index):
        source = rig.sources[key].removeprefix(UNSPECIFIED)[2:]
        yield f"  {key:<40} {_value(rig, key):>12}  {source}"


def _value(rig: object, key: str) -> str:
    """Return the number that a dotted key like `rotors[0].x_m` leads to."""
    found: object = rig
    for part in key.replace("[", ".[").split("."):
        if part.startswith("["):
            found = found[int(part[1:-1])]  # type: ignore[index]
        elif isinstance(found, dict):
            found = found[part]
        else:
            found = getattr(found, part)
    return f"{found:g}" if isinstance(found, int | float) else str(found)


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectsInputs(Inputs):
    """What `benchtool library effects` takes."""

    name: Annotated[str, Input("An effect; all are listed without.", argument="NAME")] = ""
    rig: Annotated[str, Input("Whose tolerances to show: shipped rig or TOML file.")] = "beam"


@command_from_inputs(EffectsInputs)
def effects(inputs: EffectsInputs) -> None:
    """List physical effects, or show one with law and parameters."""
    from benchtool.core.rig_file import load_rig_by_name
    from benchtool.physics.catalogue import EFFECTS, find_effect
    from benchtool.physics.effects.effect import BENCH_KINDS
    from benchtool.physics.tolerances import default_tolerances

    name, rig = inputs.name, inputs.rig
    if not name:
        for effect in EFFECTS.values():
            print(f"{effect.name:<18} {effect.subsystem:<14} {effect.title}: {effect.law}")
        return
    effect, own = find_effect(name), load_rig_by_name(rig)
    print(f"{effect.name}: {effect.title} ({effect.subsystem})")
    print(effect.description)
    print(f"law:    {effect.law}")
    print(f"shows:  {effect.shows}")
    print(f"source: {effect.source}")
    if (stated := effect.distance_law) is not None:
        values = {item.name: item.value for item in effect.parameters}
        pole = "nowhere" if stated.singular is None else f"at z/R {stated.singular(values):.3g}"
        print(f"basis:  {stated.basis}; infinite {pole}; far away {stated.far}")
        print(f"tested: {stated.tested}; seen: {stated.seen}")
        if stated.same_as:
            print(f"one law with {stated.same_as}, by another parameter")
    for other, how in effect.confused_with.items():
        print(f"looks like {other}: {how}")
    shown = [bench for bench in BENCH_KINDS if bench in effect.benches]
    print(f"candidate on: {' and '.join(f'{bench} benches' for bench in shown) or 'no bench'}")
    known = {bench: default_tolerances(effect, own, bench) for bench in shown or BENCH_KINDS[:1]}
    for item in effect.parameters:
        neutral = "no neutral value" if item.neutral is None else f"neutral {item.neutral:g}"
        matters = [
            f"{one[item.name]:.3g} ({bench})" for bench, one in known.items() if item.name in one
        ]
        tolerance = f"; tolerance on {rig}: {', '.join(matters)}" if matters else ""
        print(f"  {item.name} [{item.unit}]: {item.description}; {neutral}{tolerance}")
