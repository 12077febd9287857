"""Controllers of the user's own: making one, and telling faults in their own file and line."""

from __future__ import annotations

import traceback
from typing import Any

from benchtool.core.errors import InputError


def made(controller: type[Any], name: str) -> Any:
    """Return a new controller, for one run.

    Raises:
        InputError: it cannot be made without arguments.
    """
    try:
        return controller()
    except (Exception, SystemExit) as error:
        raise InputError(
            f"controller {name!r} could not be made without arguments: "
            f"{type(error).__name__}: {_said(error)}{_place(controller, '__init__')}; give its "
            f"arguments defaults"
        ) from error


def raised(controller: Any, error: BaseException, time_s: float) -> InputError:
    """Return one sentence that names the line of the user's own file where it went wrong."""
    frames = traceback.extract_tb(error.__traceback__)
    file = _file_of(type(controller))
    own = [frame for frame in frames if frame.filename == file]
    if not own and isinstance(error, TypeError):  # the call itself failed
        return InputError(
            f"controller {type(controller).__name__} could not be called: {_said(error)}"
            f"{_place(type(controller), 'step')}; write it as step(self, measurement, reference, "
            f"dt_s)"
        )
    frame = own[-1] if own else frames[-1]
    return InputError(
        f"controller {type(controller).__name__} raised {type(error).__name__}: {_said(error)} at "
        f"{time_s:g} s, in {frame.filename} line {frame.lineno}: {frame.line}; mend that line"
    )


def unusable(controller: Any, what: str, value: Any, time_s: float, instead: str) -> InputError:
    """Return one sentence about what a controller returned.

    Args:
        controller: of the user's own.
        what: the field, or that all of it is meant.
        value: what came.
        time_s: when.
        instead: what to return.
    """
    shown = " ".join(repr(value).split())
    return InputError(
        f"controller {type(controller).__name__} returned {what} = {shown[:80]} at {time_s:g} s"
        f"{_place(type(controller), 'step')}; return {instead}"
    )


def _said(error: BaseException) -> str:
    return " ".join(str(error).split()) or "no message"


def _place(controller: type[Any], method: str) -> str:
    """Return where a method of the class stands, as text; nothing for what is not Python."""
    code = getattr(getattr(controller, method, None), "__code__", None)
    return f", in {code.co_filename} line {code.co_firstlineno}" if code is not None else ""


def _file_of(controller: type[Any]) -> str:
    code = getattr(getattr(controller, "step", None), "__code__", None)
    return code.co_filename if code is not None else ""
