"""What an import gives: a recording, where it comes from, and all that was found on the way."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from benchtool.core.recording import Recording
from benchtool.data.repairs.finding import Finding, line_ranges


@dataclass(frozen=True, slots=True, kw_only=True)
class Tally:
    """Account for what a file holds: every row or message is in one of these numbers.

    Attributes:
        unit: "row" or "message".
        total: in the file.
        kept: in the recording.
        refused: counted, not in the recording, each with its line or byte in a finding.
        not_needed: whole and readable, of a kind that no recording holds.
    """

    unit: str
    total: int
    kept: int
    refused: int = 0
    not_needed: int = 0

    @property
    def balanced(self) -> bool:
        """Tell whether nothing was lost without a word."""
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
    rotor: int
    source: str


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Imported:
    """Hold one imported file.

    Attributes:
        recording: the values, in benchtool's channels and units.
        format: name of the format that was read.
        findings: repairs, doubts, refusals and lacks, in the order of the reading.
        tally: the account of rows or messages.
        sources: for each channel, the file's own column or message.
        windows: stretches in which a rotor is over a surface.
        lines: (n,) line of the file that each row of the recording stands in; None for logs.
    """

    recording: Recording
    format: str
    findings: tuple[Finding, ...]
    tally: Tally
    sources: Mapping[str, str] = field(default_factory=dict)
    windows: tuple[Window, ...] = ()
    lines: NDArray[np.intp] | None = None

    def with_findings(self, more: Sequence[Finding]) -> Imported:
        """Return the import with more findings."""
        return replace(self, findings=(*self.findings, *more))

    def with_values(self, name: str, values: NDArray[np.float64]) -> Imported:
        """Return the import with other numbers (n,) in one channel."""
        table = self.recording.values.copy(order="K")
        table[:, self.recording.index(name)] = values
        return replace(self, recording=replace(self.recording, values=table))

    def lines_of(self, rows: NDArray[np.intp]) -> str:
        """Return the lines of these rows as ranges; empty for logs."""
        return "" if self.lines is None else line_ranges(self.lines[rows])
