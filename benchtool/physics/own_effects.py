"""Effects of the user's own: a Python file or module that holds `EFFECT` or `EFFECTS`."""

from __future__ import annotations

from collections.abc import Iterable
from types import ModuleType

from benchtool.core.errors import InputError
from benchtool.core.own_code import CodePermit, own_module, refuse_code
from benchtool.physics.catalogue import EFFECTS
from benchtool.physics.effects.effect import Effect


def own_effects(file_or_module: str, permit: CodePermit = refuse_code) -> tuple[Effect, ...]:
    """Return the effects that a Python file, or a module found from the present folder, holds.

    Args:
        file_or_module: as the user wrote it.
        permit: called with the file before it is run.

    Raises:
        InputError: it may not be run, cannot be imported, holds no effect, or one whose name is
            taken or whose parameters cannot be judged.
    """
    module = own_module(
        file_or_module,
        f"effects of {file_or_module}",
        "give a Python file, or run where the module is",
        permit,
    )
    found = list(_listed(module, file_or_module))
    if not found:
        raise InputError(
            f"{file_or_module} holds no effect; give it EFFECT = Effect(...) or EFFECTS = [...] of "
            f"benchtool.physics.effects.effect.Effect"
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


def _listed(module: ModuleType, where: str) -> Iterable[Effect]:
    for name in ("EFFECT", "EFFECTS"):
        value = getattr(module, name, None)
        if value is None:
            continue
        for item in (value,) if isinstance(value, Effect) else _items(value, name, where):
            if not isinstance(item, Effect):
                raise InputError(
                    f"{name} of {where} holds {item!r}, which is no "
                    f"benchtool.physics.effects.effect.Effect; build it as Effect(name=..., ...)"
                )
            yield item


def _items(value: object, name: str, where: str) -> Iterable[object]:
    if isinstance(value, dict):
        return value.values()
    if isinstance(value, Iterable) and not isinstance(value, str):
        return value
    raise InputError(f"{name} of {where} is {value!r}; make it an Effect or a list of them")


def _check(effect: Effect, where: str) -> None:
    """Refuse an effect that an explanation could not judge."""
    if not effect.benches:
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
                f"nothing tells when it matters; add tolerance=... in {item.unit}"
            )
