"""Import of packages from optional extras, with an error that names the extra to install."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from benchtool.core.errors import InputError


def load_extra(module: str, extra: str, what: str) -> Any:
    """Return a module of a package that `benchtool[EXTRA]` installs.

    Args:
        what: the feature that needs it, as the subject of the error message.

    Raises:
        InputError: the package is not installed.
    """
    try:
        return import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        raise InputError(
            f"{what} needs the package {package}, which is not installed; "
            f"pip install 'benchtool[{extra}]'"
        ) from error
