"""Controllers of the user's own: making one, and telling faults in their own file and line."""

from __future__ import annotations

import traceback
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Any

from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.user_code import CodePermit, check_code_allowed, load_user_module

Controllers = Iterable[str | type[Any]]  # built-in names, ``module:Class``, or classes


def split_controllers(
    controllers: Controllers, known: Collection[Any], permit: CodePermit = check_code_allowed
) -> tuple[tuple[str, ...], list[tuple[str, type[Any]]]]:
    """Return the names of built-in controllers, and name and class of each of the user's own.

    Raises:
        InputError: none is named, one is named twice, or a class cannot be had.
    """
    given = (controllers,) if isinstance(controllers, str | type) else tuple(controllers)
    called = [one if isinstance(one, str) else one.__name__ for one in given]
    if len(set(called)) < len(called) or not called:
        raise InputError(f"controllers are {', '.join(called) or 'none'}; name each once")
    own = [
        (name, controller_class(one, known, permit) if isinstance(one, str) else one)
        for name, one in zip(called, given, strict=True)
        if one not in known
    ]
    return tuple(name for name in called if name in known), own


def make_controllers(controller: type[Any], name: str) -> Any:
    """Return a new controller, for one run.

    Raises:
        InputError: it cannot be made without arguments.
    """
    try:
        return controller()
    except (Exception, SystemExit) as error:
        raise InputError(
            f"controller {name!r} could not be made without arguments: "
            f"{type(error).__name__}: {_words(error)}{_place(controller, '__init__')}; give its "
            f"arguments defaults"
        ) from error


def controller_error(controller: Any, error: BaseException, time_s: float) -> InputError:
    """Return one sentence that names the line of the user's own file where it went wrong."""
    frames = traceback.extract_tb(error.__traceback__)
    code = _code(type(controller), "step")
    own = [frame for frame in frames if code and frame.filename == code.co_filename]
    if not own and isinstance(error, TypeError):  # the call itself failed
        return InputError(
            f"controller {type(controller).__name__} could not be called: {_words(error)}"
            f"{_place(type(controller), 'step')}; write it as step(self, measurement, reference, "
            f"dt_s)"
        )
    frame = own[-1] if own else frames[-1]
    return InputError(
        f"controller {type(controller).__name__} raised {type(error).__name__}: {_words(error)} at "
        f"{time_s:g} s, in {frame.filename} line {frame.lineno}: {frame.line}; mend that line"
    )


def invalid_command_error(
    controller: Any, what: str, value: Any, time_s: float, instead: str
) -> InputError:
    """Return one sentence about what a controller returned."""
    shown = " ".join(repr(value).split())
    return InputError(
        f"controller {type(controller).__name__} returned {what} = {shown[:80]} at {time_s:g} s"
        f"{_place(type(controller), 'step')}; return {instead}"
    )


def _words(error: BaseException) -> str:
    return " ".join(str(error).split()) or "no message"


def _place(controller: type[Any], method: str) -> str:
    """Return where a method of the class stands, as text; nothing for what is not Python."""
    code = _code(controller, method)
    return f", in {code.co_filename} line {code.co_firstlineno}" if code is not None else ""


def _code(controller: type[Any], method: str) -> Any:
    return getattr(getattr(controller, method, None), "__code__", None)


def controller_class(
    named: str, known: Iterable[str], permit: CodePermit = check_code_allowed
) -> type[Any]:
    """Return the class that `module:Class` names; modules are found in the present folder too.

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
    module = load_user_module(
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
