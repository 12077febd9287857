"""Where one of our channels stands in somebody's table."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from benchtool.core.channel import require_known_channel
from benchtool.core.errors import FileFormatError, InputError
from benchtool.core.toml_text import FiniteTable


@dataclass(frozen=True, slots=True, kw_only=True)
class ColumnSource(FiniteTable):
    """Say where one of our columns comes from.

    Attributes:
        column: the file's column; None for a constant.
        constant: one number for all rows, in `unit`.
        unit: unit of the file's numbers; when left out that in the column's own name, else ours.
        sign: -1 where the file counts the other way round.
        factor: multiplies the file's numbers (0.1651 turns z/R into metres for that R; 1/6 mends
            a wrong pole count).
        reference: of `kind` only: the cell of rows that are references, far from any plate.
    """

    column: str | None = None
    constant: float | None = None
    unit: str | None = None
    sign: Literal[-1, 1] = 1
    factor: float = 1.0
    reference: str | None = None

    def __post_init__(self) -> None:
        if (self.column is None) == (self.constant is None):
            raise InputError(
                "an entry of [columns] needs either column = 'their name' or constant = number; "
                "give exactly one of them"
            )


def check_channels(names: Iterable[str], where: str) -> None:
    """Refuse a map of a channel that nothing reads.

    Raises:
        FileFormatError: with the known ones.
    """
    for name in names:
        try:
            require_known_channel(name)
        except InputError as error:
            raise FileFormatError(f"[columns] of {where}", str(error)) from error
