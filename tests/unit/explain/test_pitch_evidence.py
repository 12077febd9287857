"""Residuals of pitch recordings: only channels that were read have rows."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.explain.pitch.evidence import PitchEvidence
from benchtool.explain.pitch.log import pitch_log
from benchtool.physics.model_file import load_model
from tests.unit.explain.pitch_made import recorded, without


@pytest.mark.parametrize(
    ("left_out", "of_hinge", "of_speeds"),
    [("nothing", 2, 2), ("gyro_rad_s", 1, 2), (r"rpm\d|gyro_rad_s", 1, 0), ("rpm2", 2, 1)],
)
def test_what_was_not_read_has_no_rows(left_out: str, of_hinge: int, of_speeds: int) -> None:
    """A row of nothing would make the others look like less than noise."""
    model = load_model("pitch_beam").model
    log = pitch_log(without(recorded(model, 1, seconds=8.0), left_out), model.rig).logged
    evidence = PitchEvidence(model, [log])
    rows = evidence.residuals(np.zeros((1, len(evidence.parameters))))[:, 0]
    counted = int(evidence.logs[0].counted.sum())
    assert len(rows) == (of_hinge + of_speeds) * counted
    stages = evidence.groups().stages
    assert stages["hinge"].sum() == of_hinge * counted
    assert stages["pwm_to_rpm"].sum() == of_speeds * counted
    assert 0.8 < np.sqrt(np.mean(rows[stages["hinge"]] ** 2)) < 1.3
