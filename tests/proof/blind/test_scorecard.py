"""The scorecard counts what it says, on made-up records."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.stats import chi2

from benchtool.explain.engine.bounded_least_squares import UNDETERMINED_HINT
from tests.proof.blind.fisher import class_confirmed
from tests.proof.blind.scorecard import Scorecard, calibration, calibration_error
from tests.proof.blind.scored import Scored, ScoredParameter, Share, share_of
from tests.proof.blind.scoring import within

RIGHT = Scored(
    kind="named",
    truth=("body_lift",),
    sizes=(3.0,),
    stage="rpm_to_thrust",
    verdict="effect",
    names=("body_lift",),
    probabilities={"body_lift": 0.95, "none": 0.01, "unknown": 0.04},
    where="rpm_to_thrust",
    gaps={"thrust_N": 1.05, "rpm": 0.99},
    true_gaps={"thrust_N": 1.0},
    parameters=(ScoredParameter(name="K_b", value=2.0, low=1.8, high=2.2, truth=2.1),),
    seconds=1.0,
)
WRONG = replace(
    RIGHT,
    names=("plate_offset",),
    probabilities={"plate_offset": 0.97, "body_lift": 0.02, "none": 0.0, "unknown": 0.01},
    where="plate",
    gaps={"thrust_N": 1.3},
    parameters=(),
)
NULL = replace(
    RIGHT,
    kind="none",
    truth=(),
    sizes=(),
    stage="",
    verdict="none",
    names=(),
    where="",
    probabilities={"body_lift": 0.02, "none": 0.9, "unknown": 0.08},
    parameters=(),
)
OUTSIDE = replace(
    NULL,
    kind="outside",
    truth=("recirculation",),
    verdict="unknown",
    probabilities={"body_lift": 0.2, "none": 0.1, "unknown": 0.7},
)
PAIR = replace(
    RIGHT,
    kind="pair",
    truth=("body_lift", "tare_offset"),
    sizes=(3.0, 4.0),
    verdict="several",
    names=("tare_offset", "body_lift"),
)
CLASS = replace(
    RIGHT,
    verdict="class",
    names=("plate_offset", "body_lift"),
    probabilities={"plate_offset": 0.5, "body_lift": 0.3, "none": 0.0, "unknown": 0.2},
    confirmed=True,
)


def figure(records: list[Scored], what: str) -> str:
    """Return what the scorecard found."""
    return next(line.found for line in Scorecard("x", records).lines() if what in line.what)


def test_wilson_intervals_are_those_of_the_formula():
    # Wilson's own formula, the roots of (p - q)^2 = z^2 q (1 - q) / n.
    for count, total in ((0, 10), (3, 10), (97, 100), (300, 300)):
        p, z2 = count / total, 1.959964**2
        roots = np.roots([1.0 + z2 / total, -(2.0 * p + z2 / total), p * p])
        assert Share(count=count, total=total).interval == pytest.approx(
            tuple(sorted(roots.real)), abs=1e-6
        )
    assert share_of([]).interval == (0.0, 1.0)


def test_named_records_are_counted():
    records = [RIGHT, RIGHT, RIGHT, WRONG, CLASS]
    assert figure(records, "single right name").startswith("3 of 5: 60.0 %")
    assert figure(records, "right name or honest class").startswith("4 of 5")
    assert figure(records, "mean size of classes") == "2.0"
    assert figure(records, "confident wrong name").startswith("1 of 5")
    assert figure(records, "gap after at most").startswith("3 of 3")
    assert figure(records, "that the true model leaves") == (
        "median 1.050, nine of ten at most 1.050"
    )
    assert figure(records, "stage right").startswith("4 of 5")
    assert figure(records, "hold the truth").startswith("3 of 3")
    assert figure(records, "seconds") == "median 1.0, most 1.0"


def test_an_aim_is_reached_where_the_bad_end_of_the_interval_is():
    """73 of 73 could be 95 %, 72 of 72 could be less."""
    for count, reached in ((72, False), (73, True)):
        lines = Scorecard("x", [RIGHT] * count).lines()
        (line,) = (line for line in lines if "honest class" in line.what and line.aim)
        assert line.reached is reached
        assert (lines[0] == line) is not reached, "what misses its aim stands first"


def test_a_class_counts_only_if_it_is_small_right_and_confirmed():
    assert CLASS.in_class
    assert not CLASS.named_first
    assert not CLASS.wrong_names
    assert not replace(CLASS, confirmed=False).in_class
    assert not replace(CLASS, names=("a", "b", "c", "body_lift")).in_class
    other = replace(CLASS, names=("plate_offset", "plate_tilt"))
    assert not other.in_class
    assert other.wrong_names == other.names


def test_nulls_and_outsiders_are_counted():
    false = replace(NULL, verdict="effect", names=("body_lift",))
    doubted = replace(NULL, verdict="unknown")
    records = [NULL, NULL, false, doubted, OUTSIDE, replace(OUTSIDE, verdict="none")]
    assert figure(records, "false name").startswith("1 of 4")
    assert figure(records, "'unknown' where nothing").startswith("1 of 4")
    assert figure(records, "'unknown' for what is outside").startswith("1 of 2")


def test_poor_records_may_say_that_an_effect_does_not_show():
    poor = replace(
        RIGHT, excitation="poor", verdict="none", names=(), not_judged={"body_lift": 5.0}, where=""
    )
    in_class = replace(CLASS, excitation="poor")
    records = [poor, replace(poor, not_judged={}), replace(poor, sizes=(6.0,)), in_class]
    assert figure(records, "poor").startswith("2 of 4")


def test_what_counts_as_right_goes_by_size():
    assert RIGHT.answers == {"body_lift"}
    assert replace(RIGHT, sizes=(0.6,), strength="weak").answers == {"none"}
    assert NULL.answers == {"none"}
    assert OUTSIDE.answers == {"unknown"}
    assert replace(OUTSIDE, strength="weak").answers == {"unknown", "none"}
    assert replace(PAIR, sizes=(0.5, 3.0)).answers == {"tare_offset"}


def test_probabilities_are_held_against_the_truth():
    assert RIGHT.stated == (0.95, True)
    assert WRONG.stated == (0.97, False)
    assert CLASS.stated == (0.8, True)
    beside = replace(OUTSIDE, probabilities={"body_lift": 1.0, "unknown": 0.9})
    assert beside.stated == (0.9, True)
    assert RIGHT.brier == pytest.approx(0.05**2 + 0.01**2 + 0.04**2)
    assert WRONG.brier == pytest.approx(0.97**2 + 0.98**2 + 0.01**2)
    assert replace(NULL, probabilities={"unknown": 1.0}).brier == pytest.approx(2.0)
    assert OUTSIDE.given_to_truth == 0.7


def test_a_calibrated_teller_has_a_small_error(rng):
    told = rng.uniform(0.5, 1.0, 4000)
    honest = [
        replace(RIGHT, probabilities={"body_lift": p})
        if rng.random() < p
        else replace(RIGHT, verdict="none", names=(), probabilities={"none": p})
        for p in told
    ]
    bins = calibration(honest)
    assert len(bins) == 10
    assert {one.count for one in bins} == {400}
    assert calibration_error(bins) < 0.03
    boasting = [replace(one, probabilities=dict.fromkeys(one.probabilities, 1.0)) for one in honest]
    assert calibration_error(calibration(boasting)) == pytest.approx(0.25, abs=0.03)


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
def test_a_class_is_confirmed_where_nobody_could_tell_its_members(names, right):
    told = Told({"b": 0.5 * UNDETERMINED_HINT, "c": 2.0 * UNDETERMINED_HINT})
    assert class_confirmed(names, ("a",), lambda: told) is right


def test_the_worst_channel_counts_against_the_floor():
    floor = {"a": np.array([0.9, 1.0, 1.0, 1.2]), "b": np.array([2.0, 2.0, 2.6, 2.0])}
    learned = {"a": np.array([1.0, 1.05]), "b": np.array([2.3, 2.1])}
    assert (within(floor, floor, 1.1), within(learned, floor, 1.1)) == (0.5, 0.5)


def test_a_share_of_chi_squared_draws_is_that_of_its_distribution():
    drawn = {"thrust_N": np.random.default_rng(0).chisquare(50, 20_000) ** 0.5}
    more = {"thrust_N": 1.1 * drawn["thrust_N"]}
    expected = chi2.cdf(1.21 * chi2.median(50), 50)
    assert within(drawn, drawn, 1.1) == pytest.approx(expected, abs=0.01)
    assert within(more, drawn, 1.1) == pytest.approx(0.5, abs=0.01)
