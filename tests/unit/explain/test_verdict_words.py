"""The sentence, the sureness and the numbers of a verdict."""

from __future__ import annotations

from dataclasses import replace

import pytest

from benchtool.explain.findings import UnjudgedEffect, UnnamedEffect
from tests.unit.explain.hand_made import FRICTION, NEXT, OFFSET, gap, verdict


def test_an_unknown_says_place_and_nearest_in_words():
    assert verdict("unknown").sentence == (
        "Something is missing at the hinge (slow reversals) that no named effect explains; the "
        "nearest is Coulomb friction, which closes 61 % of the gap."
    )


@pytest.mark.parametrize(
    ("probability", "said"),
    [
        (0.57, "The model may lack Coulomb friction"),
        (0.75, "The model probably lacks Coulomb friction"),
        (0.93, "The model lacks Coulomb friction"),
    ],
)
def test_a_verdict_is_as_sure_as_its_probability(probability, said):
    found = verdict(effects=(replace(FRICTION, probability=probability),))
    assert found.sentence.startswith(said)
    assert found.sentence.endswith(f"probability {probability:.2f}.")
    assert found.is_sure == (probability > 0.9)


CURVE = UnnamedEffect(
    name="curve", stage="rpm_to_thrust", phrase="thrust that depends on distance", probability=0.7,
    share=0.052, tolerances=2.6, weight=1.0,
)  # fmt: skip
BLIND = {
    "coulomb_friction.torque_Nm": 1.0, "cog_offset.x_m": 1.0, "cog_offset.y_m": 1.0,
    "body_lift.gain": 1.0,
}  # fmt: skip


def test_a_class_adds_up_what_it_cannot_separate():
    likely = replace(FRICTION, probability=0.5)
    assert verdict("class", effects=(likely, replace(OFFSET, probability=0.4))).sentence == (
        "The model lacks one of Coulomb friction, centre-of-gravity offset; this data cannot "
        "separate them; the most probable named effect is Coulomb friction: "
        "coulomb_friction.torque_Nm = 0.0241 ± 0.0006 N m."
    )
    said = verdict("class", effects=(likely,), unnamed=(CURVE,)).sentence
    assert said.startswith(
        "The model probably lacks one of Coulomb friction, thrust that depends on distance, up to "
        "5.2 % of the reading (2.6 tolerances); this"
    )


def test_a_class_of_one_effect_says_what_may_be_instead():
    likely = replace(FRICTION, probability=0.5)
    alike = verdict("class", effects=(likely,), gaps=())
    assert alike.class_members == ("coulomb_friction", "unknown")
    assert "probability 0.50, or lacks a similar effect with a" in alike.sentence
    left = replace(verdict("class").gaps[0], after=2.8, floor=1.0)
    mostly = verdict("class", effects=(likely,), gaps=(left,), unnamed=(CURVE,)).sentence
    assert mostly.startswith("The missing effect is mostly similar to Coulomb friction: ")
    assert mostly.endswith("; the remaining error is 2.8 noise floors.")


def test_nothing_missing_says_what_could_not_be_judged():
    seen = verdict("none", tolerances=BLIND, not_judged={})
    assert seen.sentence == "Nothing beyond the stated tolerances is missing from the model."
    at_limit = {"cog_offset": UnjudgedEffect.below(3.0)}
    assert verdict("none", tolerances=BLIND, not_judged=at_limit).sentence == seen.sentence
    some = {"cog_offset": UnjudgedEffect.below(3.1), "no such effect": UnjudgedEffect.below(9.0)}
    assert verdict("none", tolerances=BLIND, not_judged=some).sentence.endswith(
        "from the model; 1 of 3 effects were not judged."
    )
    most = verdict(
        "none", tolerances=BLIND, not_judged=some | {"body_lift": UnjudgedEffect.below(1e3)}
    )
    assert most.sentence.startswith("This data can show only 1 of 3 effects, and none of those")
    half = {name: 1.0 for name in BLIND if name[:4] != "body"}
    assert not verdict("none", tolerances=half, not_judged=some).is_mostly_unjudged


def test_an_unknown_says_what_it_is_and_what_is_beside_it():
    others = {"Coulomb friction": 0.96}
    found = verdict("unknown", unnamed=(CURVE,), nearest=None, other_effects=others)
    found = replace(found, where=replace(found.where, regime="everywhere"))
    assert found.sentence == (
        "Something is missing at the hinge that no named effect explains: thrust that depends on "
        "distance, up to 5.2 % of the reading (2.6 tolerances); also Coulomb friction, "
        "probability 0.96."
    )
    assert replace(found, where=None).sentence.startswith("Something is missing that no named")


def test_each_stage_says_all_that_is_missing_there():
    found = verdict("several", unnamed=(CURVE, replace(CURVE, stage="hinge")))
    assert found.stages == {
        "hinge": "Coulomb friction, probability 0.98; centre-of-gravity offset, probability 0.60; "
        + CURVE.text,
        "rpm_to_thrust": CURVE.text,
    }
    assert found.names == ("coulomb_friction", "cog_offset")


@pytest.mark.parametrize(
    ("kind", "probability", "holds"),
    [
        ("effect", 0.984, True), ("effect", 0.985, False), ("several", 0.6, True),
        ("several", 0.61, False), ("class", 0.0, False), ("unknown", 0.012, True),
        ("unknown", 0.013, False), ("none", 0.5, False),
    ],
)  # fmt: skip
def test_the_whole_answer_is_as_likely_as_its_least_likely_part(kind, probability, holds):
    assert verdict(kind).has_probability(probability) is holds


@pytest.mark.parametrize(
    ("kind", "probability", "sure"),
    [("effect", 0.9, True), ("effect", 0.89, False), ("class", 0.99, False), ("none", 1.0, False)],
)
def test_only_names_that_are_likely_enough_are_sure(kind, probability, sure):
    named = (replace(FRICTION, probability=probability),) if kind != "none" else ()
    assert verdict(kind, effects=named).is_sure is sure
    both = verdict("several", effects=(FRICTION, replace(FRICTION, probability=probability)))
    assert both.is_sure == (probability >= 0.9)


def test_numbers_of_a_verdict():
    (number,) = FRICTION.parameters
    assert replace(number, determined=False).text == "not determined (0.0229 to 0.0253)"
    assert replace(number, unit="1").text == "0.0241 ± 0.0006"
    whole = gap("theta_rad", "rad", 0.05, 0.03, 0.03)
    assert whole.share_closed == pytest.approx(1.0)
    assert replace(whole, after=0.04).share_closed == pytest.approx(9.0 / 16.0)
    assert replace(whole, before=0.03).share_closed == 0.0
    assert replace(whole, before=0.02).share_closed == 0.0
    assert (UnjudgedEffect.below(100.0).reason, UnjudgedEffect.below(100.0).size) == (
        "too_weak",
        100.0,
    )
    assert (UnjudgedEffect.below(101.0).reason, UnjudgedEffect.below(101.0).size) == (
        "no_trace",
        float("inf"),
    )
    assert replace(NEXT, expected={"a": 0.2, "b": 1.0}).is_decisive
    assert not replace(NEXT, expected={"a": 0.2, "b": 0.9}).is_decisive
