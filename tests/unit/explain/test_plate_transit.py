"""A plate that slides in or out untold is left out; one that is told, or stands, is judged."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.explain.pitch.evidence import PitchEvidence
from benchtool.explain.pitch.log import pitch_log
from benchtool.explain.pitch.resampling import is_plate_moving
from benchtool.physics.model_file import load_model
from tests.unit.explain.pitch_made import recorded, without


@pytest.fixture(scope="module")
def model():
    return load_model("pitch_pquad").model


@pytest.fixture(scope="module")
def visited(model):
    """The plate comes after 4 s, goes after 12 s, comes nearer after 18 s."""
    return recorded(model, 5, seconds=20.0, inertia=model.rig.body.inertia_yy_kgm2)


def test_rows_about_a_jump_are_on_the_way_and_a_missed_echo_is_none():
    plate_m = np.full(1000, 1.0)
    plate_m[500:] = 0.3
    mask, times = is_plate_moving(plate_m, 100.0)
    assert times == 1
    assert np.flatnonzero(mask).tolist() == [*range(440, 560), *range(940, 1000)]
    assert np.array_equal(is_plate_moving(plate_m[::-1], 100.0)[0], mask[::-1])
    plate_m[700:705] = 1.0
    assert is_plate_moving(plate_m, 100.0)[1] == 1
    assert not is_plate_moving(np.linspace(0.9, 0.1, 1000), 100.0)[0].any()


def test_a_plate_that_slides_untold_is_left_out_and_one_that_is_told_is_not(model, visited):
    told = pitch_log(visited, model.rig)
    assert told.remarks == ()
    assert len(told.logged) == len(visited)
    untold = pitch_log(without(visited, "coverage1"), model.rig)
    assert len(told.logged) - len(untold.logged) == (3 * 2 + 1) * 150
    assert [text for text in untold.remarks if "the plate slides in or out" in text]


def test_a_plate_whose_pace_is_said_loses_no_more_than_it_takes(model, visited):
    untold = without(visited, "coverage1")
    at_once = pitch_log(untold, model.rig, plate_slide_s=0.0)
    assert at_once.remarks == ()
    assert len(at_once.logged) == len(visited)
    brief = pitch_log(untold, model.rig, plate_slide_s=0.1)
    assert len(visited) - len(brief.logged) == (3 * 2 + 1) * 50


@pytest.mark.parametrize(
    ("left_out", "of_hinge", "of_speeds"),
    [("nothing", 2, 2), ("gyro_rad_s", 1, 2), (r"rpm\d|gyro_rad_s", 1, 0), ("rpm2", 2, 1)],
)
def test_what_was_not_read_has_no_rows(left_out, of_hinge, of_speeds):
    """A row of nothing would make the others look like less than noise."""
    model = load_model("pitch_beam").model
    log = pitch_log(without(recorded(model, 1, seconds=8.0), left_out), model.rig).logged
    evidence = PitchEvidence(model, [log])
    rows = evidence.residuals(np.zeros((1, len(evidence.parameters))))[:, 0]
    counted = evidence.logs[0].n_rows
    assert len(rows) == (of_hinge + of_speeds) * counted
    stages = evidence.groups().stages
    assert stages["hinge"].sum() == of_hinge * counted
    assert ("pwm_to_rpm" in stages) == (of_speeds > 0)
    assert (~stages["hinge"]).sum() == of_speeds * counted
    assert 0.8 < np.sqrt(np.mean(rows[stages["hinge"]] ** 2)) < 1.3


def test_recordings_whose_regimes_differ_are_explained_together():
    """One without the plate has no rows near it; together they have those of the other."""
    model = load_model("pitch_beam").model
    logs = [
        pitch_log(recorded(model, seed, seconds=8.0, schedule=name), model.rig).logged
        for seed, name in ((1, "identify"), (2, "triangle"))
    ]
    near, neither = (PitchEvidence(model, part).groups().regimes for part in ([logs[0]], [logs[1]]))
    evidence = PitchEvidence(model, logs)
    regimes = evidence.groups().regimes
    assert set(regimes) == set(near) | set(neither) != set(near)
    rows = len(evidence.residuals(np.zeros((1, len(evidence.parameters)))))
    assert {len(mask) for mask in regimes.values()} == {rows}
