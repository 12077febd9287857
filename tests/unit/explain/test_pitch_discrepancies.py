"""Innovations of discrepancies, compared with the filter itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchtool.core.units import Array
from benchtool.explain.pitch import filter as filter_
from benchtool.explain.pitch.evidence import PitchEvidence
from benchtool.explain.pitch.log import pitch_log
from benchtool.physics.model_file import load_model
from tests.unit.explain.pitch_made import recorded

MODEL = load_model("pitch_beam").model


@pytest.fixture(scope="module")
def evidence():
    log = pitch_log(recorded(MODEL, 3, seconds=12.0), MODEL.rig, "made")
    return PitchEvidence(MODEL, [log.logged])


def rows_of(evidence: PitchEvidence, **moved: float) -> Array:
    """Return residuals with parameters so many tolerances off."""
    at = np.array([moved.get(item.name.replace(".", "_"), 0.0) for item in evidence.parameters])
    return evidence.residuals(at)[:, 0]


def test_an_error_of_a_reading_runs_through_the_filter_as_it_says(evidence):
    logged = evidence.logs[0].logged
    error = 0.002 * np.sin(np.arange(len(logged)) / 40.0)
    for channel, wrong in (
        ("pitch", replace(logged, theta_rad=logged.theta_rad + error)),
        ("gyro", replace(logged, gyro_rad_s=logged.gyro_rad_s + error)),
    ):
        real = rows_of(PitchEvidence(MODEL, [wrong])) - rows_of(evidence)
        shown = evidence.logs[0].error_rows(channel, error[:, None])[:, 0]
        assert np.linalg.norm(shown - real) < 0.03 * np.linalg.norm(real)


def test_a_torque_runs_through_the_filter_as_it_says(evidence):
    """The centre of gravity off the hinge is a torque that hardly changes."""
    real = rows_of(evidence) - rows_of(evidence, cog_offset_x_m=1.0)
    item = next(one for one in evidence.parameters if one.name == "cog_offset.x_m")
    mass_kg = MODEL.rig.body.mass_kg
    weight_Nm = mass_kg * 9.81 * item.scale * np.cos(evidence.logs[0].logged.theta_rad)
    shown = evidence.logs[0].error_rows("torque", weight_Nm[:, None])[:, 0]
    assert min(np.linalg.norm(real - shown), np.linalg.norm(real + shown)) < 0.1 * np.linalg.norm(
        real
    )


def test_the_noise_of_a_reading_is_not_in_what_its_error_depends_on(evidence):
    """Else the noise of a gyro is a part of its rate: an error of per cent on a right bench."""
    logged = evidence.logs[0].logged
    noise = 0.05 * np.random.default_rng(0).standard_normal(len(logged))
    noisy = PitchEvidence(MODEL, [replace(logged, gyro_rad_s=noise)])
    before = noisy.logs[0].values("rate")
    assert abs(np.corrcoef(before, noise)[0, 1]) < 0.05
    assert np.corrcoef(before[1:], noise[:-1])[0, 1] > 0.3


def test_a_recording_in_pieces_says_what_it_says_whole(evidence, monkeypatch):
    """A filter has settled where a piece begins to count; battery sag goes on with the time."""
    whole = rows_of(evidence, battery_sag_rate_per_s=2.0)
    monkeypatch.setattr(filter_, "PIECE", 1500)
    pieces = rows_of(evidence, battery_sag_rate_per_s=2.0)
    assert np.linalg.norm(pieces - whole) < 5e-3 * np.linalg.norm(whole)
    assert evidence.logs[0].n_rows > 1.8 * 1500
