"""Load direction and readings of a load cell with hysteresis."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.core.channel import Channel
from benchtool.core.recording import Recording
from benchtool.core.rig_file import load_rig_by_name
from benchtool.physics.conditions import Conditions, load_directions
from benchtool.physics.model import Model

RIG = load_rig_by_name("pquad_single")
K = RIG.propulsion.thrust_coefficient_N_s2


def directions(levels: list[float], z_m: list[float], elapsed_s: list[float]) -> np.ndarray:
    """Return the load directions of consecutive points with these loads."""
    plate_position = np.array([z_m, [0.0] * len(levels), [0.0] * len(levels)])
    times = np.arange(len(levels), dtype=float)
    return load_directions(times, np.array(elapsed_s), plate_position, np.array(levels))


def test_a_plate_that_moves_and_a_tare_unload_the_cell():
    levels = [2.0, 3.0, 1.0, 1.001, 3.0, 2.0, 1.5, 0.0, 1.0]
    z_m = [0.1, 0.1, 0.1, 0.1, 0.2, 0.2, 0.2, 0.2, 0.2]
    since_tare = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 1.0, 2.0, 3.0]
    expected = [1.0, 1.0, -1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0]
    assert directions(levels, z_m, since_tare).tolist() == expected


def recording(*extra: tuple[Channel, np.ndarray]) -> Recording:
    """Return a recording of three levels at one plate position, up and down."""
    return Recording.from_columns(
        [
            (Channel("time_s", "s"), np.array([0.0, 10.0, 20.0])),
            (Channel("rpm1", "rpm"), np.array([4000.0, 5000.0, 4000.0])),
            (Channel("plate_z_m", "m"), np.full(3, 0.3)),
            *extra,
        ]
    )


def test_the_direction_is_from_a_column_or_the_order_of_points():
    point = (Channel("point", "1"), np.array([1.0, 2.0, 3.0]))
    column = (Channel("load_direction", "1"), np.array([-1.0, np.nan, 1.0]))
    assert Conditions.from_recording(recording(point), RIG).load_direction.tolist() == [1, 1, -1]
    assert Conditions.from_recording(recording(point, column), RIG).load_direction.tolist() == [
        -1.0,
        0.0,
        1.0,
    ]
    assert not Conditions.from_recording(recording(), RIG).load_direction.any()


def test_unloading_reads_twice_the_half_width_more_and_a_tare_row_zero():
    model = Model.single(RIG).with_effect("load_cell_hysteresis", half_width_N=0.1)
    conditions = Conditions.build(
        RIG,
        speed_rad_s=np.array([[400.0, 400.0, 0.0]]),
        plate_z_m=np.full(3, 1e6),
        load_direction=np.array([1.0, -1.0, -1.0]),
    )
    thrust = K * 400.0**2
    assert model.thrust_N(conditions) == pytest.approx([thrust - 0.2, thrust, 0.0], abs=1e-12)
    fresh = model.with_fixed("load_cell_hysteresis.tare_direction", 0.0)
    assert fresh.thrust_N(conditions) == pytest.approx([thrust - 0.1, thrust + 0.1, 0.1])


def test_points_can_be_in_any_order():
    plate_position = np.zeros((3, 3))
    times, load = np.array([2.0, 0.0, 1.0]), np.array([2.0, 1.0, 3.0])
    assert load_directions(times, times, plate_position, load).tolist() == [-1.0, 1.0, 1.0]
