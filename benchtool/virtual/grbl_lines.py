"""The G-code that a virtual stage knows: one line to words or to the number of an error. Pure.

As much of it as a stage needs: straight moves, dwells, offsets, units, distances.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

_WORD = re.compile(r"([A-Z])([-+]?(?:\d+\.?\d*|\.\d+))")
LONGEST = 80
"""Characters of a line without blanks and comments."""

GROUPS: dict[str, frozenset[str]] = {
    "motion": frozenset(("G0", "G1", "G2", "G3", "G38.2", "G80")),
    "once": frozenset(("G4", "G10", "G28.1", "G92", "G92.1")),
    "units": frozenset(("G20", "G21")),
    "distance": frozenset(("G90", "G91")),
    "plane": frozenset(("G17",)),
    "feed": frozenset(("G93", "G94")),
    "length": frozenset(("G43.1", "G49")),
    "system": frozenset(("G54",)),
    "override": frozenset(("G53",)),
    "path": frozenset(("G61",)),
    "spindle": frozenset(("M3", "M5")),
    "coolant": frozenset(("M9",)),
}
"""Codes of one group exclude each other in a line."""

_FIRST_OF = {code: group for group, codes in GROUPS.items() for code in codes}
_FRACTIONS = ("G10", "G28.1", "G92.1", "G43.1")


class Refused(Exception):
    """Carry the number of an error."""

    def __init__(self, number: int) -> None:
        self.number = number
        super().__init__(f"error:{number}")


@dataclass(frozen=True, slots=True)
class Block:
    """One line of G-code: codes by group, and the words with numbers."""

    codes: Mapping[str, str] = field(default_factory=dict)
    words: Mapping[str, float] = field(default_factory=dict)


def cleaned(line: bytes) -> str:
    """Return a line without blanks and comments, in capitals.

    Raises:
        Refused: it is too long.
    """
    text = re.sub(r"\([^)]*\)?|;.*", "", line.decode("ascii", "replace"))
    text = re.sub(r"[\s/\0]", "", text).upper()
    if len(text) > LONGEST:
        raise Refused(11)
    return text


def block_of(text: str) -> Block:
    """Return what a cleaned line says.

    Raises:
        Refused: which error it is answered by.
    """
    codes: dict[str, str] = {}
    words: dict[str, float] = {}
    at = 0
    while at < len(text):
        if not text[at].isalpha():
            raise Refused(1)
        found = _WORD.match(text, at)
        if found is None:
            raise Refused(2)
        letter, number = found[1], float(found[2])
        at = found.end()
        if letter in "GM":
            _add_code(codes, f"{letter}{number:g}", number)
        elif letter not in "FIJKLNPRSTXYZ":
            raise Refused(20)
        elif letter in words:
            raise Refused(25)
        else:
            words[letter] = number
            if letter in "FNPST" and number < 0.0:
                raise Refused(4)
            if letter == "N" and number > 9999999:
                raise Refused(27)
            if letter == "T" and number > 255:
                raise Refused(38)
    return Block(codes, words)


def _add_code(codes: dict[str, str], code: str, number: float) -> None:
    group = _FIRST_OF.get(code)
    if group is None:
        whole = f"{code[0]}{int(number)}"
        raise Refused(23 if number % 1.0 and whole in _FIRST_OF and whole not in ("G61",) else 20)
    if group in codes:
        raise Refused(21)
    codes[group] = code
