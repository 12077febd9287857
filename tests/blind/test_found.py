"""What outside families of sweeps depend on is found, with a law that closes the held-out gap."""

from __future__ import annotations

import pytest

from tests.blind.score_found import DEPENDS, found_on
from tests.blind.sweep.outside import OUTSIDE


@pytest.mark.parametrize("family", ["stand_resonance", "warming_blades", "bending_plate"])
def test_the_variable_and_a_law_are_found(family: str) -> None:
    assert found_on(family, 213) == (True, True)


def test_every_outside_family_says_what_it_depends_on() -> None:
    assert set(DEPENDS) == set(OUTSIDE)
