"""Where one of our channels stands in somebody's table."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from benchtool.core.errors import InputError
from benchtool.core.toml_text import FiniteTable
from benchtool.core.units import unit_named


@dataclass(frozen=True, slots=True, kw_only=True)
class ColumnSource(FiniteTable):
    """Say where one of our columns comes from.

    Attributes:
        column: the file's column; None for a constant.
        constant: one number for all rows, in `unit`.
        unit: unit of the file's numbers; that of our name when left out.
        sign: -1 where the file counts the other way round.
        factor: multiplies the file's numbers (0.1651 turns z/R into metres for that R; 1/6 mends
            a wrong pole count).
    """

    column: str | None = None
    constant: float | None = None
    unit: str | None = None
    sign: Literal[-1, 1] = 1
    factor: float = 1.0

    def __post_init__(self) -> None:
        if (self.column is None) == (self.constant is None):
            raise InputError(
                "an entry of [columns] needs either column = 'their name' or constant = number; "
                "give exactly one of them"
            )
        if self.unit is not None:
            unit_named(self.unit)
