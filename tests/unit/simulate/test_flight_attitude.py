"""The notes' table of section 5: restoring moments against tilt."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.rig_file import rig_named
from benchtool.simulate.pitch.attitude import hover_authority_Nm, restoring_moment

Z = np.array([1.0, 1.25, 1.5, 2.0, 3.0, 4.0, 5.0])
HALF = [
    (48.6, 124, 271), (33.5, 85, 176), (23.8, 60, 125), (12.8, 32, 66), (4.6, 11.6, 23.8),
    (2.1, 5.3, 10.8), (1.1, 2.8, 5.7),
]  # fmt: skip
DIAGONAL = [
    (40, 100),
    (23.5, 51.5),
    (17.7, 36.8),
    (12.7, 25.8),
    (7.0, 14.2),
    (3.9, 7.9),
    (2.3, 4.7),
]
ROTORS = [(41, 102), (21.9, 48.7), (14.1, 29.9), (7.5, 15.5), (3.1, 6.3), (1.5, 3.1), (0.9, 1.7)]


@pytest.mark.parametrize(
    ("reading", "tilts", "expected"),
    [
        ("per_rotor", (2.0, 5.0, 10.0), HALF),
        ("per_rotor_diagonal", (5.0, 10.0), DIAGONAL),
        ("rotors_only", (5.0, 10.0), ROTORS),
    ],
)
def test_moments_of_the_notes(reading, tilts, expected) -> None:
    found = restoring_moment(rig_named("pquad"), Z, np.radians(tilts), reading).moment_Nm * 1e3
    expected = np.array(expected)
    digit = np.where(expected >= 30.0, 0.6, 0.06)
    assert np.all(np.abs(found - expected) <= np.maximum(digit, 0.006 * expected)), found


def test_the_larger_vehicle() -> None:
    amuse = rig_named("amuse")
    found = restoring_moment(amuse, Z[[0, 3, 4, 6]], np.radians([5.0, 10.0])).moment_Nm * 1e3
    expected = [[1608, 3851], [517, 1064], [208, 426], [54, 110]]
    np.testing.assert_allclose(found, expected, rtol=0.01)
    assert hover_authority_Nm(amuse) == pytest.approx(0.45 * 12.0 * 9.81 / 2.0)
    assert hover_authority_Nm(rig_named("pquad")) == pytest.approx(1.545, abs=1e-3)


def test_it_stands_against_any_tilt_and_fades_with_height() -> None:
    tilts = np.radians([-10.0, -3.0, 3.0, 10.0])
    moments = restoring_moment(rig_named("pquad"), np.array([1.0, 2.0, 4.0]), tilts).moment_Nm
    assert np.all(moments * np.sign(tilts) > 0.0)
    np.testing.assert_allclose(moments, -moments[:, ::-1], rtol=1e-12)
    assert np.all(np.diff(np.abs(moments), axis=0) < 0.0)


def test_what_the_formulae_cannot_say_is_refused() -> None:
    with pytest.raises(InputError, match=r"below 0\.5 where"):
        restoring_moment(rig_named("pquad"), np.array([0.6]), np.radians([10.0]))
    with pytest.raises(UnknownChoice, match="rotors_only"):
        restoring_moment(rig_named("pquad"), Z, np.zeros(1), "rotor_only")  # type: ignore[arg-type]
