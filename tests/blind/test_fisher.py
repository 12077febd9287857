"""Whether a declared class is an honest one."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import pytest

from benchtool.fit.identifiability import CANNOT_TELL
from tests.blind.fisher import class_confirmed


@dataclass
class Told:
    """Speaks so clearly against each rival."""

    against: dict[str, float]

    def evidence(self, rivals: Iterable[str] = ()) -> float:
        (name,) = rivals
        return self.against[name]


@pytest.mark.parametrize(
    ("names", "right"),
    [(("a",), True), (("a", "b"), True), (("a", "b", "c"), False), (("b",), False)],
)
def test_a_class_is_confirmed_where_nobody_could_tell_its_members(
    names: tuple[str, ...], right: bool
) -> None:
    told = Told({"b": 0.5 * CANNOT_TELL, "c": 2.0 * CANNOT_TELL})
    assert class_confirmed(names, ("a",), lambda: told) is right
