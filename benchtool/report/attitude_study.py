"""Section 2.4 of the paper as a study: restoring moments, both readings of the body term."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchtool.core.rig import Rig
from benchtool.physics.images import single_rotor_factor
from benchtool.report.files import Figure
from benchtool.report.flight.attitude import MomentCurves, attitude_figure
from benchtool.report.geometry import Sketch
from benchtool.simulate.flight.rigid_body import GRAVITY_M_S2
from benchtool.simulate.pitch.attitude import READINGS, hover_authority_Nm, restoring_moment

Array = NDArray[np.float64]


def one_rotor_Nm(rig: Rig, z_over_R: float = 2.0) -> float:
    """Return the moment of a level vehicle with one outer disc wholly covered (section 4)."""
    arm = float(rig.disc_positions_m[:, 0].max())
    radius = rig.propulsion.radius_m
    share = rig.body.mass_kg * GRAVITY_M_S2 / rig.n_discs
    return float(arm * share * (single_rotor_factor(radius, z_over_R * radius) - 1.0))


def attitude_moments(rig: Rig, z_over_R: Array | None = None) -> Figure:
    """Draw figure 9 for a rig."""
    heights = np.array([1.0, 1.5, 2.0, 3.0, 5.0]) if z_over_R is None else z_over_R
    tilts = np.linspace(0.0, 10.0, 41)
    labels = {
        "per_rotor": "eq. (4) in every rotor,\n$b$ half the diagonal",
        "per_rotor_diagonal": "eq. (4) in every rotor,\n$b$ the diagonal (printed)",
        "rotors_only": "rotors only, eq. (3):\nbody's lift at the centre",
    }
    curves = [
        MomentCurves(
            labels[reading],
            tilts,
            heights,
            1e3 * restoring_moment(rig, heights, np.radians(tilts), reading).moment_Nm,  # type: ignore[arg-type]
        )
        for reading in READINGS
    ]
    sketch = Sketch(
        rotors_m=rig.disc_positions_m,
        names=tuple(rotor.name for rotor in rig.rotors[: rig.n_discs]),
        radius_m=rig.propulsion.radius_m,
        obstacle_m=(3.0, 5.0),
    )
    return attitude_figure(
        curves,
        sketch=sketch,
        authority_mNm=1e3 * hover_authority_Nm(rig),
        one_rotor_mNm=1e3 * one_rotor_Nm(rig),
        title=f"{rig.name}: ground effect turns a tilted vehicle back (Fig. 9)",
    )
