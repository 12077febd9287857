"""Restoring moments against tilt: signs and refusals; numbers are in `test_paper_tables`."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.rig_file import rig_named
from benchtool.simulate.pitch.attitude import READINGS, hover_authority_Nm, restoring_moment_Nm


def test_authority_is_half_the_lift_at_the_arms() -> None:
    assert hover_authority_Nm(rig_named("amuse")) == pytest.approx(0.45 * 12.0 * 9.81 / 2.0)
    assert hover_authority_Nm(rig_named("pquad")) == pytest.approx(1.545, abs=1e-3)


@pytest.mark.parametrize("reading", READINGS)
def test_it_stands_against_any_tilt_and_fades_with_height(reading: str) -> None:
    tilts, heights = np.radians([-10.0, -3.0, 3.0, 10.0]), np.array([1.0, 2.0, 4.0])
    moments = restoring_moment_Nm(rig_named("pquad"), heights, tilts, reading)
    assert np.all(moments * np.sign(tilts) > 0.0)
    np.testing.assert_allclose(moments, -moments[:, ::-1], rtol=1e-12)
    assert np.all(np.diff(np.abs(moments), axis=0) < 0.0)


def test_what_the_formulae_cannot_say_is_refused() -> None:
    with pytest.raises(InputError, match=r"below 0\.5 where"):
        restoring_moment_Nm(rig_named("pquad"), np.array([0.6]), np.radians([10.0]))
    with pytest.raises(UnknownChoice, match="rotors_only"):
        restoring_moment_Nm(rig_named("pquad"), np.ones(1), np.zeros(1), "rotor_only")
