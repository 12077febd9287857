"""Turn a laid-out table into a recording, column by column."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchtool.core.channel import Channel, unit_told_by
from benchtool.core.recording import Recording
from benchtool.errors import FileFormatError
from benchtool.importers.finding import Finding, counted
from benchtool.importers.foreign_units import Conversion
from benchtool.importers.imported import Imported, Tally
from benchtool.importers.numbers import numbers_of
from benchtool.importers.text_table import TextTable

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


def read_mapped(
    table: TextTable,
    columns: Sequence[Mapped],
    format_name: str,
    provenance: Mapping[str, str],
    findings: Sequence[Finding] = (),
) -> Imported:
    """Return the mapped columns of a table as an import.

    Columns whose cells are all blank are told and left out.
    """
    real = [column for column in columns if column.position is not None]
    numbers = numbers_of(table, [column.position for column in real if column.position is not None])
    found = [*table.findings, *findings, *numbers.findings]
    pairs: list[tuple[Channel, Array]] = []
    sources: dict[str, str] = {}
    empty: list[str] = []
    rows = len(numbers.lines)
    values = dict(zip((column.name for column in real), numbers.columns, strict=True))
    for column in columns:
        read = values.get(column.name)
        if read is None:
            read = np.full(rows, column.constant)
        blank = int(np.count_nonzero(np.isnan(read)))
        if rows and blank == rows:
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
        pairs.append((Channel(column.name, unit_told_by(column.name)), _converted(read, column)))
        sources[column.name] = column.source
    if empty:
        words = f"{', '.join(empty)}: blank in every row"
        found.append(Finding("lacks", "blank columns", words, count=len(empty)))
    if not rows or not pairs:
        heads = ", ".join(name for name in table.header if name)
        raise FileFormatError(
            table.where, f"no row holds numbers in the columns that are read ({heads})"
        )
    return Imported(
        recording=Recording.from_columns(pairs, {**provenance, "rows": str(rows)}),
        format=format_name,
        findings=tuple(found),
        tally=Tally(
            unit="row",
            total=table.rows_in_file,
            kept=rows,
            refused=sum(item.count for item in found if item.kind == "refused"),
        ),
        sources=sources,
        lines=numbers.lines,
    )


def _converted(values: Array, column: Mapped) -> Array:
    scale = column.conversion
    if scale.factor != 1.0:
        values = values * scale.factor
    return values + scale.offset if scale.offset else values
