"""What commands say on standard error, and what happens where an output is full or closed."""

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
from benchtool.core.resource_errors import is_exhaustion, resource_error

_NO_MEMORY = ("cannot allocate memory", "failed to map segment", "can't start new thread")
"""What loaders and threads say where an allocation failed; they raise no MemoryError for it."""

_NOT_FINITE = ("infs or NaNs", "not finite in the initial point")  # in messages of SciPy


def flush_output() -> None:
    """Write out what was printed.

    Raises:
        ResourceExhausted: standard output is full or closed.
    """
    if (error := _output_error()) is not None:
        raise resource_error(error, "standard output cannot be written") from error


def cause_behind(error: BaseException) -> ResourceExhausted | EstimationError | None:
    """Return the error for people where resources ended or numbers cannot be solved for."""
    # A write that failed names no file, and fails again where it was that of standard output.
    unnamed = isinstance(error, OSError) and error.filename is None
    if (output := _output_error("\n" if unnamed else "")) is not None:
        return resource_error(output, "standard output cannot be written")
    if isinstance(error, MemoryError) or any(words in str(error).lower() for words in _NO_MEMORY):
        return resource_error(MemoryError(), "this command was given up")
    if isinstance(error, OSError) and is_exhaustion(error):
        return resource_error(error, "a file cannot be read or written")
    if type(error).__name__ == "LinAlgError" or any(words in str(error) for words in _NOT_FINITE):
        return EstimationError(
            f"numbers of the data or the model are out of the range that can be computed "
            f"({error}); look for impossible rows and parameter values"
        )
    return None


class EscapedStream:
    """Text stream that writes control characters of files and devices as visible escapes."""

    def __init__(self, stream: TextIO) -> None:
        self.rich_proxied_file = stream

    def write(self, text: str) -> int:
        """Write a text, escaped."""
        return self.rich_proxied_file.write(show_controls(text))

    def __getattr__(self, name: str) -> Any:
        return getattr(self.rich_proxied_file, name)


def say_error(text: str) -> None:
    """Print a sentence on standard error, where that can still be written."""
    _output_error()
    with suppress(OSError, ValueError):
        print(f"benchtool: {text}", file=sys.stderr, flush=True)


def _output_error(text: str = "") -> OSError | None:
    """Print a text and return why that fails; standard output leads nowhere from then on."""
    stream = sys.__stdout__
    try:
        sys.stdout.write(text)
        sys.stdout.flush()
        if stream is not None and not stream.closed:
            stream.flush()
    except OSError as error:
        # What is left in the buffer would raise once more when the interpreter ends.
        with suppress(OSError, ValueError):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, sys.__stdout__.fileno() if sys.__stdout__ else 1)
            os.close(nowhere)
        return error
    except (ValueError, AttributeError):  # it was closed before we began
        return None
    return None


def announce_code(file: str) -> None:
    """Permit a Python file that a person named, saying on stderr that it runs."""
    print(f"runs Python code of your own: {file}", file=sys.stderr, flush=True)


def write_new(out: Path, write: Callable[[], object], hint: str = "another --out") -> None:
    """Write what must not be there yet.

    Raises:
        WouldOverwrite: something is there.
        InputError: it cannot be written.
    """
    if out.exists() or out.is_symlink():
        raise WouldOverwrite(str(out))
    try:
        write()
    except OSError as error:
        raise InputError(f"{out} cannot be written ({error.strerror}); choose {hint}") from error
