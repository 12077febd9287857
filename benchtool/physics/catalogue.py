"""Every effect by name: the folder `effects` is the list of what the tool knows."""

from __future__ import annotations

from importlib import import_module
from pkgutil import iter_modules

from benchtool.core.errors import UnknownChoice
from benchtool.physics import effects
from benchtool.physics.effects.effect import SUBSYSTEMS, BenchKind, Effect


def _found() -> list[Effect]:
    """Return the `EFFECT` of every file in the folder, in the order of the chain."""
    names = [info.name for info in iter_modules(effects.__path__) if info.name != "effect"]
    found = [import_module(f"{effects.__name__}.{name}").EFFECT for name in names]
    return sorted(found, key=lambda one: (SUBSYSTEMS.index(one.subsystem), one.order, one.name))


EFFECTS: dict[str, Effect] = {effect.name: effect for effect in _found()}
"""Every effect, in the order of the chain from pulse width to reading."""


def effect_named(name: str) -> Effect:
    """Return the effect of that name, or refuse it with the known ones."""
    try:
        return EFFECTS[name]
    except KeyError:
        raise UnknownChoice("effect", name, EFFECTS) from None


def candidates(bench: BenchKind) -> tuple[Effect, ...]:
    """Return the effects that an explanation may name on that kind of bench, in order."""
    return tuple(effect for effect in EFFECTS.values() if bench in effect.benches)
