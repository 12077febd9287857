"""Turn a laid-out table into a recording, column by column."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchtool.core.channel import Channel, unit_told_by
from benchtool.core.counted import counted
from benchtool.core.errors import FileFormatError
from benchtool.core.recording import Recording
from benchtool.data.formats.text_table import TextTable
from benchtool.data.repairs.foreign_units import Conversion
from benchtool.data.repairs.imported import Finding, Imported, Tally
from benchtool.data.repairs.numbers import numbers_of

Array = NDArray[np.float64]


AS_IT_IS = Conversion(1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Mapped:
    """Say where one channel comes from: a column of the table, or a constant.

    Attributes:
        name: our channel.
        position: of the column; None for a constant.
        conversion: from the file's unit to that of our channel, sign and factor included.
        constant: in our unit.
        source: the column and unit in the file's own words.
    """

    name: str
    position: int | None
    conversion: Conversion = AS_IT_IS
    constant: float = 0.0
    source: str = ""


Choose = Callable[[Sequence[Mapped], Mapping[str, Array], list[Finding]], Sequence[Mapped]]
"""Given the columns, their numbers by channel, and findings to add to: the columns that stay."""


def read_mapped(
    table: TextTable,
    columns: Sequence[Mapped],
    format_name: str,
    provenance: Mapping[str, str],
    findings: Sequence[Finding] = (),
    choose: Choose | None = None,
) -> Imported:
    """Return the mapped columns of a table as an import.

    Columns whose cells are all blank are told and left out.

    Args:
        table: laid out.
        columns: what to read.
        format_name: for people.
        provenance: facts for the recording.
        findings: what the reader of the header found.
        choose: looks at the numbers that were read and returns which columns stay.
    """
    real = [column for column in columns if column.position is not None]
    numbers = numbers_of(table, [column.position for column in real if column.position is not None])
    table = numbers.table
    found = [*table.findings, *findings, *numbers.findings]
    if choose is not None:
        columns = choose(
            columns, dict(zip((c.name for c in real), numbers.columns, strict=True)), found
        )
    kept: list[tuple[Mapped, int | None]] = []
    empty: list[str] = []
    rows = len(numbers.lines)
    at = {column.position: index for index, column in enumerate(real)}
    for column in columns:
        index = at[column.position] if column.position is not None else None
        read = np.array([column.constant]) if index is None else numbers.columns[index]
        blank = int(np.count_nonzero(np.isnan(read)))
        if blank == read.size:
            empty.append(column.source)
            continue
        if blank:
            found.append(
                Finding(
                    "read as", "blank cells",
                    f"{blank:,} of {counted(rows, 'row')} are blank, as a slower channel leaves "
                    f"them: no new value, nothing is filled in",
                    column.name, blank,
                )
            )  # fmt: skip
        kept.append((column, index))
    if empty:
        words = f"{', '.join(empty)}: blank in every row"
        found.append(Finding("lacks", "blank columns", words, count=len(empty)))
    if not rows or not kept:
        heads = ", ".join(name for name in table.header if name)
        raise FileFormatError(
            table.where, f"no row holds numbers in the columns that are read ({heads})"
        )
    return Imported(
        recording=_recording(numbers.columns, kept, {**provenance, "rows": str(rows)}),
        format=format_name,
        findings=tuple(found),
        tally=Tally(
            unit="row",
            total=table.rows_in_file,
            kept=rows,
            refused=sum(item.count for item in found if item.kind == "refused"),
        ),
        sources={column.name: column.source for column, _ in kept},
        lines=numbers.lines,
    )


def _recording(
    numbers: Array, kept: Sequence[tuple[Mapped, int | None]], provenance: Mapping[str, str]
) -> Recording:
    """Return the columns converted, in the memory that they were read into where that is enough.

    A million rows are long, and to be given memory for a second table takes as long as reading.
    """
    indices = [index for _, index in kept if index is not None]
    in_place = len(indices) == len(kept) and indices == sorted(set(indices))
    table = numbers if in_place else np.empty((len(kept), numbers.shape[1]))
    for row, (column, index) in enumerate(kept):
        if index is None:
            table[row] = column.constant
            continue
        scale = column.conversion
        if row != index or not in_place or scale.factor != 1.0:
            np.multiply(numbers[index], scale.factor, out=table[row])
        if scale.offset:
            table[row] += scale.offset
    channels = tuple(Channel(column.name, unit_told_by(column.name)) for column, _ in kept)
    return Recording(channels, table[: len(kept)].T, provenance)
