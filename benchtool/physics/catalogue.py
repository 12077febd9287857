"""Every effect by name: the folder `effects` is the list of what the tool knows."""

from __future__ import annotations

from collections.abc import Iterable
from importlib import import_module
from pathlib import Path

from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.rig import Surface
from benchtool.core.user_code import CodePermit, check_code_allowed, load_user_module
from benchtool.physics import effects
from benchtool.physics.effects.effect import SUBSYSTEMS, BenchKind, Effect
from benchtool.physics.effects.laws.table import LAWS


def _found() -> list[Effect]:
    """Return the effects of every file in the folder and below, in the order of the chain."""
    folder = Path(effects.__path__[0])
    files = (path.relative_to(folder).with_suffix("") for path in folder.rglob("[!_]*.py"))
    names = (f"{effects.__name__}.{'.'.join(path.parts)}" for path in files)
    found = [one for name in names if (one := getattr(import_module(name), "EFFECT", None))]
    found += LAWS.values()
    return sorted(found, key=lambda one: (SUBSYSTEMS.index(one.subsystem), one.order, one.name))


HOW_TO = "the form of an effect file is in docs/how-to/extend.md#effects"
EFFECTS: dict[str, Effect] = {effect.name: effect for effect in _found()}


def find_effect(name: str) -> Effect:
    """Return the effect of that name, or refuse it with the known ones."""
    try:
        return EFFECTS[name]
    except KeyError:
        raise UnknownChoice("effect", name, EFFECTS) from None


def candidates(bench: BenchKind) -> tuple[Effect, ...]:
    """Return the effects that an explanation may name on that kind of bench, in order."""
    return tuple(effect for effect in EFFECTS.values() if bench in effect.benches)


def never_tried(bench: BenchKind) -> tuple[Effect, ...]:
    """Return effects that act on a bench of that kind and that no explanation may name."""
    return tuple(
        effect
        for effect in EFFECTS.values()
        if not effect.benches
        and effect.subsystem == {"sweep": "rpm_to_thrust", "pitch": "hinge"}[bench]
        and (effect.hooks.factor or effect.hooks.dry_friction or effect.hooks.torque) is not None
    )


def thrust_laws(surface: Surface) -> tuple[Effect, ...]:
    """Return the laws of thrust against the distance of a surface that lies there, in order."""
    return tuple(
        effect
        for effect in EFFECTS.values()
        if effect.distance_law is not None and effect.distance_law.surface == surface
    )


def user_effects(
    file_or_module: str, permit: CodePermit = check_code_allowed
) -> tuple[Effect, ...]:
    """Return the effects that a Python file, or a module found from the present folder, holds.

    Raises:
        InputError: it may not be run, cannot be imported, holds no effect, or one whose name is
            taken or whose parameters cannot be judged.
    """
    try:
        module = load_user_module(
            file_or_module,
            f"effects of {file_or_module}",
            "give a Python file, or run where the module is",
            permit,
        )
    except InputError as error:
        if not isinstance(error.__cause__, ImportError | TypeError | AttributeError):
            raise
        raise InputError(f"{error}; {HOW_TO}") from error
    found: list[Effect] = []
    for name in ("EFFECT", "EFFECTS"):
        value = getattr(module, name, ())
        items = (value,) if isinstance(value, Effect) else value
        items = items.values() if isinstance(items, dict) else items
        if not isinstance(items, Iterable) or isinstance(items, str):
            raise InputError(
                f"{name} of {file_or_module} is {value!r}; make it an Effect or a list of them"
            )
        for item in items:
            if not isinstance(item, Effect):
                raise InputError(
                    f"{name} of {file_or_module} holds {item!r}, which is no "
                    f"benchtool.physics.effects.effect.Effect; build it as Effect(name=..., ...)"
                )
            found.append(item)
    if not found:
        raise InputError(
            f"{file_or_module} holds no effect; give it EFFECT = Effect(...) or EFFECTS = [...] of "
            f"benchtool.physics.effects.effect.Effect; {HOW_TO}"
        )
    names = [effect.name for effect in found]
    for effect in found:
        if effect.name in EFFECTS:
            raise InputError(
                f"effect {effect.name!r} of {file_or_module} has the name of a shipped one; name "
                f"yours otherwise"
            )
        if names.count(effect.name) > 1:
            raise InputError(f"{file_or_module} holds two effects named {effect.name!r}; keep one")
        _check(effect, file_or_module)
    return tuple(found)


def _check(effect: Effect, where: str) -> None:
    """Refuse an effect that an explanation could not judge."""
    if not effect.benches and effect.distance_law is None:
        raise InputError(
            f"effect {effect.name!r} of {where} is no candidate on any bench; give it benches = "
            f'frozenset({{"pitch"}}), or "sweep", or both'
        )
    if effect.tolerance_of is not None:
        return
    for item in effect.parameters:
        if item.neutral is not None and item.tolerance is None:
            raise InputError(
                f"parameter {item.name} of effect {effect.name!r} in {where} has no tolerance, so "
                f"it is not known when it matters; add tolerance=... in {item.unit}"
            )
