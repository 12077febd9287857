"""Catalogue of all effects in the folder `effects`, by name."""

from __future__ import annotations

from collections.abc import Iterable
from importlib import import_module
from pathlib import Path

from benchtool.core.choices import Surface
from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.user_code import CodePermit, check_code_allowed, load_user_module
from benchtool.physics import effects
from benchtool.physics.effects.effect import SUBSYSTEMS, BenchKind, Effect
from benchtool.physics.effects.laws.table import LAWS


def _import_effects() -> list[Effect]:
    """Return the effects of all files in the folder and below, in order of application."""
    folder = Path(effects.__path__[0])
    files = (path.relative_to(folder).with_suffix("") for path in folder.rglob("[!_]*.py"))
    modules = (import_module(f"{effects.__name__}.{'.'.join(path.parts)}") for path in files)
    imported = [effect for module in modules if (effect := getattr(module, "EFFECT", None))]
    imported += LAWS.values()
    return sorted(imported, key=lambda it: (SUBSYSTEMS.index(it.subsystem), it.order, it.name))


HOW_TO = "the form of an effect file is in docs/how-to/extend.md#effects"
EFFECTS: dict[str, Effect] = {effect.name: effect for effect in _import_effects()}


def find_effect(name: str) -> Effect:
    """Return the effect of that name."""
    try:
        return EFFECTS[name]
    except KeyError:
        raise UnknownChoice("effect", name, EFFECTS) from None


def candidates(bench: BenchKind) -> tuple[Effect, ...]:
    """Return the effects that an explanation may name on that kind of bench, in order."""
    return tuple(effect for effect in EFFECTS.values() if bench in effect.benches)


def non_candidates(bench: BenchKind) -> tuple[Effect, ...]:
    """Return the effects with influence on that kind of bench that no explanation may name."""
    return tuple(
        effect
        for effect in EFFECTS.values()
        if not effect.benches
        and effect.subsystem == {"sweep": "rpm_to_thrust", "pitch": "hinge"}[bench]
        and (effect.hooks.factor or effect.hooks.dry_friction or effect.hooks.torque) is not None
    )


def thrust_laws(surface: Surface) -> tuple[Effect, ...]:
    """Return the laws of thrust against distance for that position of the surface, in order."""
    return tuple(
        effect
        for effect in EFFECTS.values()
        if effect.distance_law is not None and effect.distance_law.surface == surface
    )


def user_effects(
    file_or_module: str, permit: CodePermit = check_code_allowed
) -> tuple[Effect, ...]:
    """Return the effects of a Python file or of a module importable from the current folder."""
    try:
        module = load_user_module(
            file_or_module,
            f"effects of {file_or_module}",
            "give a Python file, or run in the folder of the module",
            permit,
        )
    except InputError as error:
        if not isinstance(error.__cause__, ImportError | TypeError | AttributeError):
            raise
        raise InputError(f"{error}; {HOW_TO}") from error
    imported: list[Effect] = []
    for name in ("EFFECT", "EFFECTS"):
        value = getattr(module, name, ())
        items = (value,) if isinstance(value, Effect) else value
        items = items.values() if isinstance(items, dict) else items
        if not isinstance(items, Iterable) or isinstance(items, str):
            raise InputError(
                f"{name} of {file_or_module} is {value!r}; expected an Effect or a list of effects"
            )
        for item in items:
            if not isinstance(item, Effect):
                raise InputError(
                    f"{name} of {file_or_module} contains {item!r}, which is not a "
                    f"benchtool.physics.effects.effect.Effect; build it as Effect(name=..., ...)"
                )
            imported.append(item)
    if not imported:
        raise InputError(
            f"{file_or_module} contains no effect; define EFFECT = Effect(...) or EFFECTS = [...] "
            f"of benchtool.physics.effects.effect.Effect; {HOW_TO}"
        )
    names = [effect.name for effect in imported]
    for effect in imported:
        if effect.name in EFFECTS:
            raise InputError(
                f"effect {effect.name!r} of {file_or_module} has the name of an effect of "
                f"benchtool; use another name"
            )
        if names.count(effect.name) > 1:
            raise InputError(
                f"{file_or_module} contains two effects named {effect.name!r}; remove one"
            )
        _check_effect(effect, file_or_module)
    return tuple(imported)


def _check_effect(effect: Effect, file: str) -> None:
    """Raise if an explanation could not judge the effect."""
    if not effect.benches and effect.distance_law is None:
        raise InputError(
            f"effect {effect.name!r} of {file} is not a candidate on any bench; set benches = "
            f'frozenset({{"pitch"}}), {{"sweep"}} or both'
        )
    if effect.tolerance_of is not None:
        return
    for item in effect.parameters:
        if item.neutral is not None and item.tolerance is None:
            raise InputError(
                f"parameter {item.name} of effect {effect.name!r} in {file} has no tolerance; add "
                f"tolerance=... in {item.unit}"
            )
