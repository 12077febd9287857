"""The verdict's sentence: the field's words, and a code word only as a parameter's full name."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest

from benchtool.explain.engine.verdict import KINDS, PLACES, STAGES, Kind
from benchtool.physics.catalogue import EFFECTS
from benchtool.physics.effects.effect import SUBSYSTEMS
from tests.unit.explain.hand_made import FRICTION, verdict


@pytest.mark.parametrize("kind", KINDS)
def test_code_words_stand_only_where_a_parameter_is_named(kind: Kind) -> None:
    found = verdict(kind)
    rest = found.sentence
    for effect in found.effects:
        for item in effect.parameters:
            rest = rest.replace(f"{effect.name}.{item.name} = ", "")
    assert not re.search(r"\w_\w", rest)


def test_an_unknown_says_place_and_nearest_in_words() -> None:
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
def test_a_verdict_is_as_sure_as_its_probability(probability: float, said: str) -> None:
    found = verdict(effects=(replace(FRICTION, probability=probability),))
    assert found.sentence.startswith(said)
    assert found.sentence.endswith(f"probability {probability:.2f}.")
    assert found.is_sure == (probability > 0.9)


def test_no_probability_is_told_as_one() -> None:
    assert "probability above 0.99." in verdict(
        effects=(replace(FRICTION, probability=0.9994),)
    ).sentence  # fmt: skip


def test_of_several_effects_each_is_told_as_sure_as_it_is() -> None:
    said = verdict("several").sentence
    assert said.startswith("The model lacks Coulomb friction: ")
    assert "probability 0.98; and may lack centre-of-gravity offset: " in said


def test_every_stage_and_every_effect_reads_in_a_sentence() -> None:
    assert set(PLACES) == set(SUBSYSTEMS)
    assert set(STAGES) == set(SUBSYSTEMS)
    assert EFFECTS["cog_offset"].phrase == "centre-of-gravity offset"
    assert EFFECTS["coulomb_friction"].phrase == "Coulomb friction"
