"""User code, run only with permission; its errors are reported with file and line."""

from __future__ import annotations

import importlib
import importlib.util
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

from benchtool.core.errors import InputError

CodePermit = Callable[[str], None]  # called with a file before it is run; raises to prevent it


def check_code_allowed(file: str) -> None:
    """Raise InputError: permit for all files that were not named on the command line."""
    raise InputError(
        f"{file} is user code and is not run from run folders, recipes, addresses in data or the "
        f"page; name its model file on the command line, for example with --model"
    )


def load_user_module(
    file_or_module: str, what: str, otherwise: str, permit: CodePermit
) -> ModuleType:
    """Import and return a Python file, or a module, also from the current folder.

    Args:
        what: subject of messages ("effects of cubic.py").
        otherwise: remedy if it does not exist.

    Raises:
        InputError: not permitted, not found, or raised during import.
    """
    path = Path(file_or_module)
    is_file = path.suffix == ".py"
    if is_file and not path.is_file():
        raise InputError(f"{what}: there is no such file; check the path")
    permit(str(path) if is_file else _origin(file_or_module))
    try:
        return _file(path) if is_file else importlib.import_module(file_or_module)
    except ImportError as error:
        raise InputError(f"{what}: {error}; {otherwise}") from error
    except (Exception, SystemExit) as error:
        raise InputError(
            f"{what}: it raised {type(error).__name__}: "
            f"{' '.join(str(error).split()) or 'no message'} while it was imported{_where(error)}; "
            f"correct that line"
        ) from error


def _file(path: Path) -> ModuleType:
    name = f"benchtool_own_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise ImportError(f"{path} is not a Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # compiled hooks are looked up there
    spec.loader.exec_module(module)
    return module


def _origin(name: str) -> str:
    """Return the file of a module without running it; its name if it is not found.

    Modules are also found in the current folder.
    """
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.insert(0, here)
    try:
        spec = importlib.util.find_spec(name.partition(".")[0])
    except (ImportError, ValueError):
        return name
    return spec.origin or name if spec is not None else name


def _where(error: BaseException) -> str:
    """Return file and line of the last frame in a file, as text."""
    if isinstance(error, SyntaxError):  # has file and line in its message
        return ""
    frames = traceback.extract_tb(error.__traceback__)
    in_files = [frame for frame in frames if not frame.filename.startswith("<")]
    return f", in {in_files[-1].filename} line {in_files[-1].lineno}" if in_files else ""
