"""Controllers of the user's own by name: `module:Class`."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.own_code import CodePermit, own_module, refuse_code
from benchtool.simulate.controllers.pitch import PITCH_CONTROLLERS


def controller_class(
    named: str, known: Iterable[str] = PITCH_CONTROLLERS, permit: CodePermit = refuse_code
) -> type[Any]:
    """Return the class that `module:Class` names; modules are found in the present folder too.

    Args:
        named: as the user wrote it.
        known: the built-in controllers, for somebody who meant one of these.
        permit: called with the module's file before it is run.

    Raises:
        InputError: the module cannot be imported, or has no such class with `step`.
    """
    module_name, _, class_name = named.partition(":")
    if not module_name or not class_name:
        raise UnknownChoice("controller (and not of the form module:Class)", named, known)
    if module_name.endswith(".py"):
        raise InputError(
            f"controller {named!r} names a file; name the module: "
            f"{Path(module_name).stem}:{class_name}, from the folder where it stands"
        )
    module = own_module(
        module_name,
        f"controller {named!r}",
        f"run where {module_name}.py is, or install it",
        permit,
    )
    found = getattr(module, class_name, None)
    if not isinstance(found, type) or not callable(getattr(found, "step", None)):
        raise InputError(
            f"controller {named!r}: {module_name} has no class {class_name} with a method step"
        )
    return found
