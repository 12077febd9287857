"""What an import gives: a recording, where it comes from, and all that was found on the way."""

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
    """Account for what a file holds: every row or message is in one of these numbers.

    Attributes:
        unit: "row" or "message".
        refused: counted, not in the recording, each with its line or byte in a finding.
        not_needed: whole and readable, of a kind that no recording holds.
    """

    unit: str
    total: Count
    kept: Count
    refused: Count = 0
    not_needed: Count = 0

    @property
    def balanced(self) -> bool:
        """Whether nothing was lost without a finding."""
        return self.total == self.kept + self.refused + self.not_needed


@dataclass(frozen=True, slots=True, kw_only=True)
class Window:
    """Mark a stretch of time in which a rotor is over a surface.

    Attributes:
        start_s, end_s: in the recording's own time.
        rotor: its number; 0 for all.
        source: "user", or the sensor that says so.
    """

    start_s: float
    end_s: float
    rotor: Count
    source: str


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ImportResult:
    """Hold one imported file.

    Attributes:
        recording: the values, in benchtool's channels and units.
        findings: repairs, doubts, refusals and lacks, in the order of the reading.
        tally: the account of rows or messages.
        sources: for each channel, the file's own column or message.
        windows: when a rotor is over a surface.
        propeller: that stood on the bench, as the user or the file says; None where neither does.
        lines: (n,) line of the file that each row of the recording stands in; None for logs.
    """

    recording: Recording
    format: str
    findings: tuple[Finding, ...]
    tally: ImportCount
    sources: Mapping[str, str] = field(default_factory=dict)
    windows: tuple[Window, ...] = ()
    lines: NDArray[np.intp] | None = None
    propeller: Propeller | None = None

    def with_findings(self, findings: Sequence[Finding]) -> ImportResult:
        """Return the import with more findings."""
        return replace(self, findings=(*self.findings, *findings))

    def with_values(self, name: str, values: NDArray[np.float64]) -> ImportResult:
        """Return the import with other numbers (n,) in one channel."""
        table = self.recording.values.copy(order="K")
        table[:, self.recording.index(name)] = values
        return replace(self, recording=replace(self.recording, values=table))

    def format_lines(self, rows: NDArray[np.intp]) -> str:
        """Return the lines of these rows as ranges; empty for logs."""
        return "" if self.lines is None else line_ranges(self.lines[rows])


Kind = Literal["repaired", "refused", "doubt", "left out", "lacks", "read as"]


@dataclass(frozen=True, slots=True)
class Finding:
    """Report one thing about a file that its reader must know.

    Attributes:
        kind: "repaired" (mended as the words say), "refused" (rows or bytes that are not in the
            recording), "doubt" (left as it is; look at it), "left out" (columns or messages that
            a recording does not need), "lacks" (what the file does not hold), "read as" (a choice
            of reading that the file does not settle, or settles only by a convention).
        what: the matter in two or three words, the same for the same matter in every file.
        words: a sentence with the numbers.
        channel: the channel or column it is about; empty for the whole file.
        count: rows, cells, messages or bytes it is about.
        lines: which lines of the file, as ranges ("3, 7-12"); empty where lines say nothing.
    """

    kind: Kind
    what: str
    words: str
    channel: str = ""
    count: int = 0
    lines: str = ""

    @property
    def sentence(self) -> str:
        """The finding in one line of text."""
        about = f" ({self.channel})" if self.channel else ""
        return f"{self.kind}: {self.what}{about}: {self.words}"


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
    """Hold the options of an import.

    Attributes:
        columns: column map for a CSV; None lets the header speak.
        flip: channels whose sign is reversed.
        tare: channels whose reading at rest is taken off.
        scale: factors as CHANNEL=FACTOR.
        air_density_kg_m3: for files that hold coefficients.
        propeller: that stood on the bench, for coefficients and tip speeds.
        hover_kg: mass of the vehicle whose weight is the thrust of a hover flight.
        over: windows in which a rotor is over a surface.
        near_m: a distance sensor that reads less says that the vehicle is over a surface; None
            lets it say nothing.
    """

    columns: Path | None = None
    flip: tuple[str, ...] = ()
    tare: tuple[str, ...] = ()
    scale: tuple[str, ...] = ()
    air_density_kg_m3: float | None = None
    propeller: Propeller | None = None
    hover_kg: float | None = None
    over: tuple[Window, ...] = ()
    near_m: float | None = None


def import_metadata(result: ImportResult, options: ImportOptions) -> dict[str, Any]:
    """Return what the JSON beside an imported recording says of the import."""
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
