"""The four ratio figures of the paper (Int. J. Aerospace Eng. 2017, 1823056) as layouts.

Each takes its series under the name it has in the caption and gives it the role, so that the same
thing keeps its colour from figure to figure; the drawing is `ground_effect.ratio_figure`.
"""

from __future__ import annotations

from dataclasses import replace

from matplotlib.figure import Figure

from benchtool.report.sweep.ground_effect import Curve, RatioPoints, ratio_figure


def two_rigs_figure(
    first: RatioPoints,
    second: RatioPoints,
    formula: Curve,
    *fits: Curve,
    simulated: bool,
    basis: str,
    title: str = "A single rotor near the ground, two rigs",
) -> Figure:
    """Draw figure 3: one rotor of each of two rigs over the PFI curve (eq. 2)."""
    return ratio_figure(
        (replace(first, role="single_rotor"), replace(second, role="second_rig")),
        (replace(formula, role="formula"), *fits),
        title=title,
        simulated=simulated,
        basis=basis,
    )


def quad_against_single_figure(
    single: RatioPoints,
    quad: RatioPoints,
    single_formula: Curve,
    quad_formula: Curve,
    *fits: Curve,
    simulated: bool,
    basis: str,
    title: str = "A quadrotor against a single rotor",
) -> Figure:
    """Draw figure 4: quad and single rotor over their PFI curves (eq. 3 and eq. 2)."""
    return ratio_figure(
        (replace(single, role="single_rotor"), replace(quad, role="quad")),
        (replace(single_formula, role="formula"), replace(quad_formula, role="quad"), *fits),
        title=title,
        simulated=simulated,
        basis=basis,
    )


def body_lift_figure(
    single: RatioPoints,
    quad: RatioPoints,
    single_formula: Curve,
    body_lift_formula: Curve,
    *fits: Curve,
    simulated: bool,
    basis: str,
    title: str = "A quadrotor with body lift",
) -> Figure:
    """Draw figure 6: as figure 4, the quad's curve with the body-lift term (eq. 4)."""
    return ratio_figure(
        (replace(single, role="single_rotor"), replace(quad, role="quad")),
        (
            replace(single_formula, role="formula"),
            replace(body_lift_formula, role="body_lift"),
            *fits,
        ),
        title=title,
        simulated=simulated,
        basis=basis,
    )


def three_rotors_figure(
    three: RatioPoints,
    single_formula: Curve,
    three_formula: Curve,
    *fits: Curve,
    simulated: bool,
    basis: str,
    title: str = "Three rotors of a quadrotor",
) -> Figure:
    """Draw figure 8: three rotors switched on, over the PFI curves for one and for three."""
    return ratio_figure(
        (replace(three, role="three_rotors"),),
        (
            replace(single_formula, role="formula"),
            replace(three_formula, role="three_rotors"),
            *fits,
        ),
        title=title,
        simulated=simulated,
        basis=basis,
    )
