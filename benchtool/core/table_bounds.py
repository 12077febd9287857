"""Size limits of imported tables, and their checks."""

from __future__ import annotations

from benchtool.core.errors import FileFormatError

MAX_COLUMNS = 4096  # of any table; the widest logs have some hundred; assumed
MAX_CELLS = 6_000_000  # of a table read as text: about 0.6 GB; assumed
MAX_TABLE_BYTES = 1 << 28  # largest file of such a table
MAX_LOG_BYTES = 1 << 30  # largest imported file: hours of an autopilot's log; assumed
MAX_DECODED_BYTES = 1 << 31  # of one recording: 10^7 rows of 25 channels; assumed
MAX_NUMBER = 1e20  # largest magnitude in any unit: its products stay finite; assumed


def check_columns(count: int, where: str) -> None:
    """Raise FileFormatError for a table with too many columns."""
    if count > MAX_COLUMNS:
        raise FileFormatError(
            where, f"it has {count:,} columns, limit {MAX_COLUMNS:,}; keep those that you need"
        )


def check_cells(count: int, where: str) -> None:
    """Raise FileFormatError for a table with too many cells for memory."""
    if count > MAX_CELLS:
        raise FileFormatError(
            where,
            f"it has {count:,} cells, limit {MAX_CELLS:,}; keep the rows and columns that you need",
        )


def check_decoded(rows: int, columns: int, where: str) -> None:
    """Raise FileFormatError for a table of float64 that is too large for memory."""
    decoded = 8 * rows * columns
    if decoded > MAX_DECODED_BYTES:
        raise FileFormatError(
            where,
            f"its {rows:,} rows of {columns} columns take {decoded / 1e9:.1f} GB when they are "
            f"read, limit {MAX_DECODED_BYTES / 1e9:.1f} GB; write fewer rows or columns",
        )
