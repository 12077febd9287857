"""Result of an import: recording, sources, counts and findings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge
from numpy.typing import NDArray

from benchtool.core.recording import Recording
from benchtool.core.rig import Propeller

Count = Annotated[int, Ge(0)]


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportCount:
    """Counts of a file's rows or messages; each one is in one of them."""

    unit: str  # "row" or "message"
    total: Count
    kept: Count
    refused: Count = 0  # not in the recording, each with its line or byte in a finding
    not_needed: Count = 0  # readable, but of a kind that recordings do not contain

    @property
    def is_balanced(self) -> bool:
        """True if the counts add up to the total."""
        return self.total == self.kept + self.refused + self.not_needed


@dataclass(frozen=True, slots=True, kw_only=True)
class Window:
    """Time window in which a rotor is over a surface."""

    start_s: float
    end_s: float  # in the recording's time
    rotor: Count  # its number; 0 for all
    source: str  # "user" or name of the sensor


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ImportResult:
    """Imported file."""

    recording: Recording  # values in benchtool's channels and units
    findings: tuple[Finding, ...]  # in the order of their detection
    tally: ImportCount  # counts of rows or messages
    format: str = ""  # name of a variant of the format; by default that of the format
    sources: Mapping[str, str] = field(default_factory=dict)  # column or message by channel
    windows: tuple[Window, ...] = ()  # with a rotor over a surface
    lines: NDArray[np.intp] | None = None  # (n,) line in the file of each row; None for logs
    propeller: Propeller | None = None  # of the bench, from the user or the file; None if unknown

    def with_findings(self, findings: Sequence[Finding]) -> ImportResult:
        """Return the import result with additional findings."""
        return replace(self, findings=(*self.findings, *findings))

    def with_values(self, name: str, values: NDArray[np.float64]) -> ImportResult:
        """Return the import with the numbers (n,) of one channel replaced."""
        table = self.recording.values.copy(order="K")
        table[:, self.recording.index(name)] = values
        return replace(self, recording=replace(self.recording, values=table))

    def format_lines(self, rows: NDArray[np.intp]) -> str:
        """Return the lines of these rows as ranges; empty for logs."""
        return "" if self.lines is None else line_ranges(self.lines[rows])


Kind = Literal["repaired", "refused", "doubt", "left out", "lacks", "read as"]


@dataclass(frozen=True, slots=True)
class Finding:
    """Entry of the import report.

    Attributes:
        kind: "repaired", "refused" (rows or bytes not in the recording), "doubt" (unchanged, to be
            checked by the user), "left out" (columns or messages that a recording does not need),
            "lacks" (missing in the file), "read as" (an assumption or convention).
    """

    kind: Kind
    what: str  # topic in two or three words, the same in every file
    words: str  # message with the numbers
    channel: str = ""  # the channel or column; empty for the whole file
    count: int = 0  # rows, cells, messages or bytes concerned
    lines: str = ""  # of the file, as ranges ("3, 7-12"); empty if not applicable


def line_ranges(lines: Sequence[int] | NDArray[np.intp]) -> str:
    """Return line numbers as ranges: 3, 7-12."""
    numbers = np.unique(np.array(lines, np.int64))
    if not numbers.size:
        return ""
    breaks = np.flatnonzero(np.diff(numbers) > 1)
    runs = np.split(numbers, breaks + 1)
    return ", ".join(f"{run[0]}-{run[-1]}" if run.size > 1 else f"{run[0]}" for run in runs)


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportOptions:
    """Options of an import."""

    columns: Path | None = None  # column map for a CSV; None uses the header
    flip: tuple[str, ...] = ()  # channels whose sign is reversed
    tare: tuple[str, ...] = ()  # channels whose reading at rest is subtracted
    scale: tuple[str, ...] = ()  # factors as CHANNEL=FACTOR
    air_density_kg_m3: float | None = None  # for files with coefficients
    propeller: Propeller | None = None  # of the bench, for coefficients and tip speeds
    hover_kg: float | None = None  # mass of the vehicle of a hover flight, to compute the thrust
    over: tuple[Window, ...] = ()  # windows in which a rotor is over a surface
    near_m: float | None = None  # distance readings below it are over a surface; None: unused


def import_metadata(result: ImportResult, options: ImportOptions) -> dict[str, Any]:
    """Return the import's entries for the JSON metadata of the recording."""
    from benchtool import __version__

    metadata: dict[str, Any] = {
        "imported_as": result.format,
        "tally": asdict(result.tally),
        "sources": dict(result.sources),
        "findings": [asdict(entry) for entry in result.findings],
        "windows": [asdict(entry) for entry in result.windows],
        "options": {
            key: str(value) for key, value in asdict(options).items() if value not in (None, ())
        },
        "versions": {"benchtool": __version__},
    }
    if result.propeller is not None:
        metadata["propeller"] = asdict(result.propeller)
    if options.air_density_kg_m3 is not None:
        metadata["air"] = {"density_kg_m3": options.air_density_kg_m3, "stated": True}
    return metadata
