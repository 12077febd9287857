"""Draw the figures of the documentation: python docs/assets/draw.py

The curves are the formulae of `benchtool.aero`; the points are those formulae with seeded scatter,
so that the layouts can be seen without a bench. Every figure says that it is simulated.
"""

from __future__ import annotations

from math import sqrt
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchtool.aero.body_lift import quad_body_lift_factor
from benchtool.aero.images import quad_factor, single_rotor_factor
from benchtool.aero.multirotor import three_rotor_average_factor
from benchtool.report.files import save_figure
from benchtool.report.ground_effect import Curve, RatioPoints
from benchtool.report.paper_figures import (
    body_lift_figure,
    quad_against_single_figure,
    three_rotors_figure,
    two_rigs_figure,
)

# PQUAD; the spacing is an assumption, for the paper gives none.
RADIUS_M, SPACING_M, K_B = 0.12, 0.318, 2.0
HALF_DIAGONAL_M = SPACING_M / sqrt(2.0)

Z_OVER_R = np.linspace(0.5, 6.0, 221)
MEASURED_AT = np.array([0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0])
SCATTER = 0.01


def single(z_over_R: NDArray[np.float64]) -> NDArray[np.float64]:
    """Give eq. (2)."""
    return np.asarray(single_rotor_factor(RADIUS_M, z_over_R * RADIUS_M))


def three(z_over_R: NDArray[np.float64]) -> NDArray[np.float64]:
    """Give three rotors of the quad together, without a body term."""
    return np.asarray(three_rotor_average_factor(RADIUS_M, z_over_R * RADIUS_M, SPACING_M))


def quad(z_over_R: NDArray[np.float64]) -> NDArray[np.float64]:
    """Give eq. (3)."""
    return np.asarray(quad_factor(RADIUS_M, z_over_R * RADIUS_M, SPACING_M))


def body_lift(z_over_R: NDArray[np.float64]) -> NDArray[np.float64]:
    """Give eq. (4) with b as half the diagonal."""
    z_m = z_over_R * RADIUS_M
    return np.asarray(quad_body_lift_factor(RADIUS_M, z_m, SPACING_M, HALF_DIAGONAL_M, K_B))


def figures() -> dict[str, Figure]:
    """Draw the paper's four layouts, by file name."""
    rng = np.random.default_rng(1823056)

    def points(ratio: NDArray[np.float64], repeats: int, label: str, shift: float) -> RatioPoints:
        drawn = ratio + rng.normal(0.0, SCATTER, (repeats, ratio.size))
        return RatioPoints(MEASURED_AT + shift, drawn.mean(0), drawn.std(0, ddof=1), label)

    eq2 = Curve(Z_OVER_R, single(Z_OVER_R), "PFI, one rotor, eq. (2)")
    eq3 = Curve(Z_OVER_R, quad(Z_OVER_R), "PFI, four rotors, eq. (3)")
    eq4 = Curve(Z_OVER_R, body_lift(Z_OVER_R), "PFI with body lift, eq. (4), $K_b$ = 2")
    averaged = Curve(Z_OVER_R, three(Z_OVER_R), "PFI, three rotors")
    pquad = points(single(MEASURED_AT), 9, "PQUAD, one rotor, $R$ = 0.12 m", 0.0)
    amuse = points(single(MEASURED_AT + 0.06), 9, "AMUSE, one rotor, $R$ = 0.205 m", 0.06)
    four = points(body_lift(MEASURED_AT), 5, "PQUAD, four rotors", 0.0)
    some = points(three(MEASURED_AT), 5, "PQUAD, three rotors", 0.0)
    said = {"simulated": True, "basis": "equal_rpm2"}
    return {
        "ratio-two-rigs": two_rigs_figure(pquad, amuse, eq2, **said),
        "ratio-quad-and-single": quad_against_single_figure(pquad, four, eq2, eq3, **said),
        "ratio-body-lift": body_lift_figure(pquad, four, eq2, eq4, **said),
        "ratio-three-rotors": three_rotors_figure(some, eq2, averaged, **said),
    }


def draw(folder: Path) -> None:
    """Write every figure as SVG."""
    for name, figure in figures().items():
        save_figure(figure, folder / name, ("svg",), replace=True)


if __name__ == "__main__":
    draw(Path(__file__).parent)
