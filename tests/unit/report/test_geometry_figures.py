"""The drawings of how things are set up: figures 7, 10, 11 and 29."""

from __future__ import annotations

from benchtool.commands.paper.figures import geometry_figures
from benchtool.core.rig_file import rig_named
from benchtool.simulate.flight.cases import PLATE_S, plate_under_front

RIG = rig_named("pquad")


def test_all_four_are_drawn_and_none_says_simulated() -> None:
    figures = geometry_figures(RIG)
    assert list(figures) == [
        "fig07-partial-effect",
        "fig10-map",
        "fig11-cases",
        "fig29-plate-set-up",
    ]
    for figure in figures.values():
        assert "simulated" not in " ".join(text.get_text() for text in figure.texts).lower()


def test_the_plate_of_figure_29_is_that_of_the_flight() -> None:
    above, side = geometry_figures(RIG)["fig29-plate-set-up"].axes
    radius, arm = RIG.propulsion.radius_m, float(RIG.disc_positions_m[:, 0].max())
    (near, far) = plate_under_front(radius, arm).blocks[0].x_m
    for axes in (above, side):
        drawn = [patch.get_extents() for patch in axes.patches[:2]]  # where it waits, where it acts
        inverse = axes.transData.inverted()
        ends = [inverse.transform(each)[:, 0].tolist() for each in drawn]
        assert abs(ends[1][0] - near) + abs(ends[1][1] - far) < 1e-9
        assert abs(ends[0][0] - near - 1.0) < 1e-9
    green = [patch for patch in above.patches[2:] if patch.get_edgecolor()[1] > 0.55]
    assert len(green) == 1  # one rotor alone is over the plate
    said = " ".join(text.get_text() for text in above.texts)
    for time_s in PLATE_S:
        assert f"{time_s:g}" in said
