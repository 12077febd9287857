"""What outside families depend on is found, with a law that closes the held-out gap."""

from __future__ import annotations

import pytest

from tests.proof.blind.pitch import outside as pitch
from tests.proof.blind.score_found import DEPENDS, LAWLESS, found_on
from tests.proof.blind.sweep import outside as sweep


@pytest.mark.parametrize("family", ["stand_resonance", "warming_blades", "bending_plate"])
def test_the_variable_and_a_law_are_found(family):
    assert found_on("sweep", family, 213) == (True, True)


@pytest.mark.parametrize("family", ["drag_vane"])
def test_on_a_pitch_bench_too(family):
    assert found_on("pitch", family, 100) == (True, True)


def test_every_outside_family_says_what_it_depends_on():
    assert set(DEPENDS["sweep"]) == set(sweep.OUTSIDE)
    assert set(DEPENDS["pitch"]) == set(pitch.OUTSIDE) > set(LAWLESS)
