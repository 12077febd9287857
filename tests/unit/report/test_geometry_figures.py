"""The drawings of how things are set up: figures 7, 10, 11 and 29."""

from __future__ import annotations

from benchtool.core.rig_file import rig_named
from benchtool.report.figure import drawn
from benchtool.simulate.flight.cases import PLATE_S, plate_under_front
from tests.contracts.figure_subjects import Flights

RIG = rig_named("pquad")


def test_the_plate_of_figure_29_is_that_of_the_flight() -> None:
    above, side = drawn("paper", Flights(), ["fig29-plate-set-up"])[
        "fig29-plate-set-up"
    ].figure.axes
    radius, arm = RIG.propulsion.radius_m, float(RIG.disc_positions_m[:, 0].max())
    (near, far) = plate_under_front(radius, arm).blocks[0].x_m
    for axes in (above, side):
        places = [
            patch.get_extents() for patch in axes.patches[:2]
        ]  # where it waits, where it acts
        inverse = axes.transData.inverted()
        ends = [inverse.transform(each)[:, 0].tolist() for each in places]
        assert abs(ends[1][0] - near) + abs(ends[1][1] - far) < 1e-9
        assert abs(ends[0][0] - near - 1.0) < 1e-9
    green = [patch for patch in above.patches[2:] if patch.get_edgecolor()[1] > 0.55]
    assert len(green) == 1  # one rotor alone is over the plate
    said = " ".join(text.get_text() for text in above.texts)
    for time_s in PLATE_S:
        assert f"{time_s:g}" in said
