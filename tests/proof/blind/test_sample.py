"""A short sample of the scorecards, on development seeds; `make blind` makes them whole."""

from __future__ import annotations

import os

import pytest

from tests.proof.blind import score_foreign, score_pitch, score_sweep, score_virtual
from tests.proof.blind.scored import Scored
from tests.proof.blind.scoring import Asked

SWEEPS = (
    Asked(7000, "body_lift"),
    Asked(7000, "tare_offset", excitation="poor"),
    Asked(7000, "none"),
    Asked(7000, "recirculation"),
    Asked(7000, "pair"),
)
PITCHES = (Asked(7000, "hinge_spring"), Asked(7000, "none"))


@pytest.fixture(scope="module")
def sweeps():
    return [score_sweep.scored(one) for one in SWEEPS]


@pytest.fixture(scope="module")
def pitches():
    return [score_pitch.scored(one) for one in PITCHES]


def check_sample(records: list[Scored]) -> None:
    """Assert what holds of nearly every record, so of a few."""
    for one in records:
        assert sum(one.probabilities.values()) > 0.99, one.label
        assert not one.confidently_wrong, one.label
        if one.kind == "named" and one.excitation == "rich":
            assert one.named_first, one.label
            assert one.where == one.stage, one.label
        if one.kind == "none":
            assert one.verdict == "none", one.label
        if one.kind == "outside":
            assert one.verdict == "unknown", one.label


def test_sweeps_are_explained(sweeps):
    check_sample(sweeps)
    poor = next(one for one in sweeps if one.excitation == "poor")
    assert poor.honest
    assert next(one for one in sweeps if one.kind == "pair").both_named


def test_pitch_records_are_explained(pitches):
    check_sample(pitches)


@pytest.mark.parametrize("family", ["sweeps", pytest.param("pitch", marks=pytest.mark.proof)])
def test_foreign_benches_are_scored_by_the_same_form(family):
    if not os.environ.get("BENCHTOOL_REFERENCE_DATA"):
        pytest.skip("no generator of foreign benches: BENCHTOOL_REFERENCE_DATA is not set")
    plan = list(score_foreign.asked(family, score_foreign.SCORING.start, 1.0))
    assert {one.seed for one in plan} <= set(score_foreign.SCORING)
    found = score_foreign.scored(family, Asked(0, "none"))
    assert (found.kind, found.verdict) == ("none", "none")
    assert set(score_foreign.DEVELOPMENT).isdisjoint(score_foreign.SCORING)


def test_a_virtual_bench_that_ships_is_recorded_and_explained():
    check_sample([score_virtual.scored("quad", Asked(2, "load_cell_hysteresis"))])
