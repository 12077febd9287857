"""Every row and sign of the mixer, for plus, cross and any other layout."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.core.rig_file import rig_named
from benchtool.physics.mixer import WRENCH, mixer_matrix, pitch_moment_Nm

K, C, ARM = 1.2e-5, 1.8e-7, 0.225


ROWS = {row: number for number, row in enumerate(WRENCH)}


def test_moments_are_arm_times_force(rng):
    """Compare with the cross product r x F and with drag opposing the spin."""
    n = 7
    x, y = rng.uniform(-0.5, 0.5, (2, n))
    spin = rng.choice([-1.0, 1.0], n)
    squares = rng.uniform(1e4, 1e6, n)
    places = np.stack([x, y, np.zeros(n)], axis=1)
    forces = np.stack([np.zeros(n), np.zeros(n), K * squares], axis=1)
    torque = np.cross(places, forces).sum(axis=0)
    torque[2] += -(spin * C * squares).sum()
    got = mixer_matrix(x, y, spin, K, C) @ squares
    np.testing.assert_allclose(got, [forces[:, 2].sum(), *torque], rtol=1e-12)
    assert pitch_moment_Nm(K * squares, x) == pytest.approx(torque[1], rel=1e-12)


@pytest.mark.parametrize(
    ("row", "signs"),
    [
        ("thrust_N", {"front": 1, "left": 1, "rear": 1, "right": 1}),
        ("roll_Nm", {"front": 0, "left": 1, "rear": 0, "right": -1}),
        ("pitch_Nm", {"front": -1, "left": 0, "rear": 1, "right": 0}),
        ("yaw_Nm", {"front": -1, "left": 1, "rear": -1, "right": 1}),
    ],
)
@pytest.mark.parametrize(("rig_name", "ring"), [("pquad", ""), ("amuse", "_upper")])
def test_every_row_of_the_paper_s_vehicles_is_equation_9(rig_name, ring, row, signs):
    """Axes x forward, y left, z up, rotor 1 in front; of coaxial pairs the upper rotors."""
    rig = rig_named(rig_name)
    rotors = [place for place in rig.rotors if place.name.endswith(ring)]
    assert [place.name.removesuffix(ring) for place in rotors] == list(signs)
    x, y, spin = (
        np.array([getattr(place, key) for place in rotors], float) for key in ("x_m", "y_m", "spin")
    )
    propulsion = rig.propulsion
    k, c = propulsion.thrust_coefficient_N_s2, propulsion.drag_coefficient_Nm_s2
    scale = {"thrust_N": k, "yaw_Nm": c}.get(row, k * float(np.hypot(x, y)[0]))
    printed = scale * np.array([*signs.values()], float)
    np.testing.assert_allclose(mixer_matrix(x, y, spin, k, c)[ROWS[row]], printed, atol=1e-20)
