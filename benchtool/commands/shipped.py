"""What ships as files, on the terminal: a list, one of them in words, or the file itself."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Annotated

import typer

AsToml = Annotated[
    bool, typer.Option("--toml", help="Print the file itself, to start one of your own.")
]


def show_shipped(
    kind: str,
    name: str,
    toml: bool,
    *,
    listed: Callable[[], Iterable[str]],
    described: Callable[[str], Iterable[str]],
) -> None:
    """Print a list without a name; with one, the file itself or what it says.

    Args:
        kind: what it is, in the singular; its files lie in the folder of the plural.
        name: of a shipped file, or the path of the user's own; "" for the list.
        toml: print the file.
        listed: gives a line for each that ships.
        described: gives the lines of one; it refuses what is no such file.
    """
    from benchtool.core.packaged import read_named

    lines = described(name) if name else listed()
    if name and toml:
        list(lines)  # a file that cannot be used is refused, not printed
        print(read_named(kind, f"{kind}s", name)[0], end="")
        return
    for line in lines:
        print(line)
