"""Source of a channel in a foreign table."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from benchtool.core.channel import require_known_channel
from benchtool.core.errors import FileFormatError, InputError
from benchtool.core.toml_text import FiniteTable


@dataclass(frozen=True, slots=True, kw_only=True)
class ColumnSource(FiniteTable):
    """Source of one channel: a column or a constant.

    Attributes:
        column: the file's column; None for a constant.
        constant: one number for all rows, in `unit`.
        unit: unit of the file's numbers; default: that in the column name, else the channel's.
        sign: -1 if the file uses the opposite sign.
        factor: factor on the file's numbers (0.1651 converts z/R to metres for that R; 1/6 corrects
            a wrong pole count).
        reference: for `kind` only: cell text of reference rows, far from any plate.
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
                "an entry of [columns] needs either column = 'NAME' or constant = NUMBER; give "
                "exactly one of them"
            )


def check_channels(names: Iterable[str], where: str) -> None:
    """Raise FileFormatError for a map with an unknown channel."""
    for name in names:
        try:
            require_known_channel(name)
        except InputError as error:
            raise FileFormatError(f"[columns] of {where}", str(error)) from error
