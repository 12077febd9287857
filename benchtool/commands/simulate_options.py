"""Options that every closed-loop simulation takes, what is read from them, and its words."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Sequence
from math import isfinite
from pathlib import Path
from typing import Annotated, Any

import typer

from benchtool.core.errors import InputError

Gains = Annotated[
    list[str] | None,
    typer.Option(
        help="Gain set (s3, s1a, stiff), or its file; s3 when left out; several in a campaign."
    ),
]
Duration = Annotated[
    float,
    typer.Option(
        "--duration-s", help="Length in seconds; its own when left out.", show_default=False
    ),
]
Seed = Annotated[int, typer.Option(help="Seed of the noise.", min=0)]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set", help="NAME=VALUE, as gains.attitude=1.2 (a factor) or gains.attitude.k_q_per_s=8."
    ),
]
Varied = Annotated[
    list[str] | None,
    typer.Option("--vary", help="NAME=FROM:TO:COUNT: a campaign over a grid; --out is needed."),
]
Seeds = Annotated[int, typer.Option(help="Seeds per point of a campaign.", min=1)]
Samples = Annotated[int, typer.Option(help="Random points in place of the grid.", min=0)]
MeasureName = Annotated[
    str,
    typer.Option("--measure", help="What the map of a campaign shows; the main one when left out."),
]
Out = Annotated[
    Path | None,
    typer.Option(help="Folder for recordings or table, and figure.", file_okay=False),
]


def say_if_slow() -> None:
    """Say that simulations are slow here, where they are."""
    from benchtool.physics.expression import can_compile

    if not can_compile():
        print(
            "numba is not installed, so this runs as plain Python and takes minutes; "
            "pip install benchtool[fast] makes it a second",
            file=sys.stderr,
        )


def controller_names(text: str, known: Iterable[str]) -> list[str]:
    """Return the controllers of a list with commas: built-in ones, and the user's own."""
    names = [name.strip() for name in text.split(",") if name.strip()]
    if not names:
        raise InputError(f"no controller was named; name some of: {', '.join(known)}")
    if len(set(names)) < len(names):
        raise InputError(f"a controller is named twice: {', '.join(names)}; name each once")
    return names


def gain_sets(words: Sequence[str] | None) -> list[str]:
    """Return the gain sets that were asked for; s3 without."""
    names = [name.strip() for word in words or ["s3"] for name in word.split(",") if name.strip()]
    if not names or len(set(names)) < len(names):
        raise InputError(f"--gains is {', '.join(words or [])!r}; name each gain set once")
    return names


def one_gain_set(names: Sequence[str]) -> str:
    """Return the only gain set of a single simulation."""
    if len(names) > 1:
        raise InputError(
            f"{len(names)} gain sets ({', '.join(names)}) are for a campaign; add --vary, or name "
            f"one"
        )
    return names[0]


def numbers_between_commas(option: str, text: str, count: int) -> tuple[float, ...]:
    """Return so many numbers with commas between."""
    try:
        numbers = tuple(float(word) for word in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != count or not all(map(isfinite, numbers)):
        raise InputError(f"{option} is {text!r}; give {count} numbers with commas between")
    return numbers


def refuse_without_vary(**given: Any) -> None:
    """Refuse options of a campaign where nothing is varied."""
    for option, present in given.items():
        if present:
            raise InputError(
                f"--{option} is for a campaign; add --vary NAME=FROM:TO:COUNT or leave it out"
            )


def show_study(
    lines: Iterable[str], write: Callable[[Path], Iterable[Path]], out: Path | None
) -> None:
    """Print what came out, and write it where a folder was named."""
    for line in lines:
        print(line, flush=True)
    if out is None:
        print("add --out FOLDER for the recordings (CSV) and the figure")
        return
    try:
        written = list(write(out))
    except OSError as error:
        raise InputError(
            f"{out} cannot be written: {error.strerror or error}; name another folder with --out"
        ) from error
    for path in written:
        print(f"written: {path}")
