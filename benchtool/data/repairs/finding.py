"""A finding: one repair, doubt, refusal or lack that an import must tell."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Kind = Literal["repaired", "refused", "doubt", "left out", "lacks", "read as"]


@dataclass(frozen=True, slots=True)
class Finding:
    """Tell one thing about a file that its reader must know.

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


def line_ranges(lines: Iterable[int] | NDArray[np.intp]) -> str:
    """Return line numbers as ranges: 3, 7-12."""
    numbers = np.unique(np.asarray(list(lines), np.int64))
    if not numbers.size:
        return ""
    breaks = np.flatnonzero(np.diff(numbers) > 1)
    firsts = numbers[np.concatenate([[0], breaks + 1])]
    lasts = numbers[np.concatenate([breaks, [numbers.size - 1]])]
    pairs = zip(firsts.tolist(), lasts.tolist(), strict=True)
    return ", ".join(str(first) if first == last else f"{first}-{last}" for first, last in pairs)
