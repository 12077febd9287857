"""Messages on standard error, and detection of a full disk or a closed standard output."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, TextIO

from benchtool.core.errors import (
    EstimationError,
    InputError,
    ResourceExhausted,
    WouldOverwrite,
    show_controls,
)
from benchtool.core.user_file import is_exhaustion, resource_error

# Errors of the loader and of threads after a failed allocation, in place of MemoryError
_NO_MEMORY = ("cannot allocate memory", "failed to map segment", "can't start new thread")

_NOT_FINITE = ("infs or NaNs", "not finite in the initial point")  # in messages of SciPy


def flush_output() -> None:
    """Flush standard output.

    Raises:
        ResourceExhausted: standard output is full or closed.
    """
    if (error := _output_error()) is not None:
        raise resource_error(error, "standard output cannot be written") from error


def find_cause(error: BaseException) -> ResourceExhausted | EstimationError | None:
    """Return the benchtool error for exhausted resources or unsolvable numbers, else None."""
    # A failed write has no file name; it fails again if it was to standard output.
    is_write = isinstance(error, OSError) and error.filename is None
    if (output := _output_error("\n" if is_write else "")) is not None:
        return resource_error(output, "standard output cannot be written")
    if isinstance(error, MemoryError) or any(text in str(error).lower() for text in _NO_MEMORY):
        return resource_error(MemoryError(), "this command was stopped")
    if isinstance(error, OSError) and is_exhaustion(error):
        return resource_error(error, "a file cannot be read or written")
    if type(error).__name__ == "LinAlgError" or any(text in str(error) for text in _NOT_FINITE):
        return EstimationError(
            f"values of the data or the model are not computable ({error}); check for implausible "
            f"rows and parameter values"
        )
    return None


class EscapedStream:
    """Text stream wrapper that escapes control characters."""

    def __init__(self, stream: TextIO) -> None:
        self.rich_proxied_file = stream

    def write(self, text: str) -> int:
        """Write a text, escaped."""
        return self.rich_proxied_file.write(show_controls(text))

    def __getattr__(self, name: str) -> Any:
        return getattr(self.rich_proxied_file, name)


def print_error(text: str) -> None:
    """Print a message on standard error; ignore write errors."""
    _output_error()
    with suppress(OSError, ValueError):
        print(f"benchtool: {text}", file=sys.stderr, flush=True)


def _output_error(text: str = "") -> OSError | None:
    """Print a text and return the write error; standard output is the null device after it."""
    stream = sys.__stdout__
    try:
        sys.stdout.write(text)
        sys.stdout.flush()
        if stream is not None and not stream.closed:
            stream.flush()
    except OSError as error:
        # The remaining buffer would raise again at interpreter exit.
        with suppress(OSError, ValueError):
            null_device = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null_device, sys.__stdout__.fileno() if sys.__stdout__ else 1)
            os.close(null_device)
        return error
    except (ValueError, AttributeError):  # closed before the call
        return None
    return None


def typed_command() -> str:
    """Return the command line of this process."""
    import shlex

    return shlex.join(["benchtool", *sys.argv[1:]])


def announce_code(file: str) -> None:
    """Permit user code and print its file on standard error."""
    print(f"running user code: {file}", file=sys.stderr, flush=True)


def write_new(out: Path, write: Callable[[], object], hint: str = "another --out") -> None:
    """Write a new file or folder.

    Raises:
        WouldOverwrite: it exists.
        InputError: it cannot be written.
    """
    if out.exists() or out.is_symlink():
        raise WouldOverwrite(str(out))
    try:
        write()
    except OSError as error:
        raise InputError(f"{out} cannot be written ({error.strerror}); choose {hint}") from error
