"""A plate moved by hand: what is typed in is checked before it is believed."""

import pytest

from benchtool.bench.stage.stage import HandStage
from benchtool.core.errors import StageError
from benchtool.core.rig_file import rig_named

PLATE = rig_named("pquad_single").plate


def stage(*answers):
    asked = []
    left = list(answers)

    def ask(question):
        asked.append(question)
        return left.pop(0)

    return HandStage(ask, PLATE), asked


def move(hand, z_m=0.24, x_m=0.0, tilt_rad=0.0):
    return hand.move(z_m, x_m, tilt_rad, lambda duration_s: None)


@pytest.mark.parametrize("answer", ["241.5", " 241.5 mm", "241,5"])
def test_the_measured_distance_is_what_counts(answer):
    hand, asked = stage(answer)
    assert move(hand) == pytest.approx(0.2415)
    assert asked == ["Move the plate to 240.0 mm, then type the distance that you measure in mm: "]


def test_a_wrong_answer_is_asked_again_with_what_is_wrong():
    hand, asked = stage("", "0.24", "262", "240")
    hand = HandStage(hand._ask, PLATE, tries=4)
    assert move(hand) == pytest.approx(0.24)
    assert "'' is not a number" in asked[1]
    assert "0.2 mm is outside 50.0 to 1500.0 mm" in asked[2]
    assert "262.0 mm is 22.0 mm off, tolerance 5.0 mm" in asked[3]


def test_it_is_given_up_after_three_wrong_answers():
    hand, _ = stage("1", "2", "300")
    with pytest.raises(StageError, match=r"after 3 tries: 300\.0 mm is 60\.0 mm off"):
        move(hand)


def test_lateral_position_and_tilt_are_told():
    hand, asked = stage("240")
    move(hand, 0.24, -0.05, 0.1)
    assert "240.0 mm, -50.0 mm sideways, tilted +5.7 degrees" in asked[0]
