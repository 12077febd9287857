"""The verdict's sentence: the field's words, and a code word only as a parameter's full name."""

from __future__ import annotations

import re

import pytest

from benchtool.effects.catalogue import EFFECTS
from benchtool.effects.effect import STAGES
from benchtool.explain.stage_words import PLACES, stage_words
from benchtool.explain.verdict import KINDS, Kind, in_sentence
from tests.unit.explain.hand_made import verdict


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


def test_every_stage_and_every_effect_reads_in_a_sentence() -> None:
    assert set(PLACES) == set(STAGES)
    assert not any("_" in stage_words(stage) for stage in STAGES)
    assert in_sentence("Centre-of-gravity offset") == "centre-of-gravity offset"
    kept = {effect.name for effect in EFFECTS.values() if in_sentence(effect.title)[0].isupper()}
    assert kept == {"coulomb_friction", "stribeck"}
