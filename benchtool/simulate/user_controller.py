"""User-defined controllers: loading, construction, and error messages with file and line."""

from __future__ import annotations

import traceback
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Any

from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.user_code import CodePermit, check_code_allowed, load_user_module

Controllers = Iterable[str | type[Any]]  # built-in names, ``module:Class``, or classes


def split_controllers(
    controllers: Controllers,
    builtin_names: Collection[Any],
    permit: CodePermit = check_code_allowed,
) -> tuple[tuple[str, ...], list[tuple[str, type[Any]]]]:
    """Return the names of built-in controllers, and name and class of each user-defined one."""
    entries = (controllers,) if isinstance(controllers, str | type) else tuple(controllers)
    names = [entry if isinstance(entry, str) else entry.__name__ for entry in entries]
    if len(set(names)) < len(names) or not names:
        raise InputError(f"controllers {', '.join(names) or 'none'} are invalid; name each once")
    user_defined = [
        (
            name,
            load_controller_class(entry, builtin_names, permit)
            if isinstance(entry, str)
            else entry,
        )
        for name, entry in zip(names, entries, strict=True)
        if entry not in builtin_names
    ]
    return tuple(name for name in names if name in builtin_names), user_defined


def make_controller(controller: type[Any], name: str) -> Any:
    """Return a new controller, constructed without arguments, for one run."""
    try:
        return controller()
    except (Exception, SystemExit) as error:
        raise InputError(
            f"controller {name!r} cannot be constructed without arguments: {type(error).__name__}: "
            f"{_message(error)}{_location(controller, '__init__')}; give its arguments "
            f"defaults"
        ) from error


def controller_error(controller: Any, error: BaseException, time_s: float) -> InputError:
    """Return an error with the line of the user's file that raised."""
    frames = traceback.extract_tb(error.__traceback__)
    code = _code(type(controller), "step")
    user_frames = [frame for frame in frames if code and frame.filename == code.co_filename]
    if not user_frames and isinstance(error, TypeError):  # the call itself failed
        return InputError(
            f"controller {type(controller).__name__} cannot be called: "
            f"{_message(error)}{_location(type(controller), 'step')}; write it as step(self, "
            f"measurement, reference, dt_s)"
        )
    frame = user_frames[-1] if user_frames else frames[-1]
    return InputError(
        f"controller {type(controller).__name__} raised {type(error).__name__}: {_message(error)} "
        f"at {time_s:g} s, in {frame.filename} line {frame.lineno}: {frame.line}; correct that line"
    )


def invalid_command_error(
    controller: Any, field: str, value: Any, time_s: float, remedy: str
) -> InputError:
    """Return an error about an invalid return value of a controller."""
    text = " ".join(repr(value).split())
    return InputError(
        f"controller {type(controller).__name__} returned {field} = {text[:80]} at {time_s:g} s"
        f"{_location(type(controller), 'step')}; return {remedy}"
    )


def _message(error: BaseException) -> str:
    return " ".join(str(error).split()) or "no message"


def _location(controller: type[Any], method: str) -> str:
    """Return file and line of a method as text; "" if it is not Python code."""
    code = _code(controller, method)
    return f", in {code.co_filename} line {code.co_firstlineno}" if code is not None else ""


def _code(controller: type[Any], method: str) -> Any:
    return getattr(getattr(controller, method, None), "__code__", None)


def load_controller_class(
    name: str, builtin_names: Iterable[str], permit: CodePermit = check_code_allowed
) -> type[Any]:
    """Return the class `module:Class`; modules are also looked up in the current folder."""
    module_name, _, class_name = name.partition(":")
    if not module_name or not class_name:
        raise UnknownChoice("controller (and not of the form module:Class)", name, builtin_names)
    if module_name.endswith(".py"):
        raise InputError(
            f"controller {name!r} is a file; use the module: "
            f"{Path(module_name).stem}:{class_name}, from the folder of the file"
        )
    module = load_user_module(
        module_name,
        f"controller {name!r}",
        f"run in the folder of {module_name}.py, or install it",
        permit,
    )
    controller = getattr(module, class_name, None)
    if not isinstance(controller, type) or not callable(getattr(controller, "step", None)):
        raise InputError(
            f"controller {name!r}: {module_name} has no class {class_name} with a method step"
        )
    return controller
