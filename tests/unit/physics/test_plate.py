"""Where a plate lies under a rotor plane, and where the formulae hold."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchtool.core.rig_file import rig_named
from benchtool.physics import VALIDITY_Z_OVER_R
from benchtool.physics.images import clamped_height
from benchtool.physics.model import Model
from benchtool.physics.tilt import axis_cosine, height_over, plate_plane

angles = st.floats(-0.4, 0.4)
places = st.floats(-0.4, 0.4)


@given(places, places, places, angles)
def test_a_plate_pivots_about_its_own_centre(x, y, plate_x, tilt):
    """The distance from a disc to the plane through (plate_x, 0, -z) with the tilted normal."""
    plane = plate_plane(0.4, plate_x, tilt)
    normal = np.array([-np.sin(tilt), 0.0, np.cos(tilt)])
    expected = normal @ (np.array([x, y, 0.0]) - np.array([plate_x, 0.0, -0.4]))
    assert height_over(plane, x, y) == pytest.approx(expected, abs=1e-14)
    assert axis_cosine(plane) == pytest.approx(np.cos(tilt), rel=1e-14)


def test_heights_below_the_limit_are_clamped():
    z = np.array([0.01, 0.0599, 0.06, 0.5])
    np.testing.assert_array_equal(clamped_height(z, 0.5 * 0.12), [0.06, 0.06, 0.06, 0.5])
    assert Model.single(rig_named("pquad")).nearest_z_over_R == VALIDITY_Z_OVER_R == 0.5
