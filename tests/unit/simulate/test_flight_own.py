"""A user's own flight controller: the same loop, stopped at every period."""

from __future__ import annotations

from dataclasses import replace
from math import cos, inf, nan
from typing import Any

import numpy as np
import pytest

from benchtool.core.errors import InputError
from benchtool.simulate.controllers.controller import (
    FlightCommand,
    FlightMeasurement,
    FlightReference,
    make_controller,
)
from benchtool.simulate.flight.cases import Goal
from benchtool.simulate.flight.environment import Environment
from benchtool.simulate.flight.flight import fly, fly_user_controller
from benchtool.simulate.gain_file import load_gains
from tests.unit.simulate.flying import PQUAD, case

SHORT = case(duration_s=0.4)


def limited(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))


class Cascade:
    """The published cascade with the gains of S3, as somebody would write it."""

    def __init__(self) -> None:
        body = PQUAD.rig.body
        self.inertias = (body.inertia_xx_kgm2, body.inertia_yy_kgm2, body.inertia_zz_kgm2)
        self.mass = body.mass_kg
        self.wanted, self.integral, self.climb = [0.0, 0.0], [0.0, 0.0], 0.0

    def acceleration(self, axis: int, error: float, speed: float, v: float, dt_s: float) -> float:
        ask = limited(1.1 * error, speed)
        self.wanted[axis] += limited(ask - self.wanted[axis], 0.65 * dt_s)
        off = self.wanted[axis] - v
        self.integral[axis] = limited(self.integral[axis] + 0.6 * off * dt_s, 0.58)
        return 1.5 * off + self.integral[axis]

    def step(self, seen: FlightMeasurement, want: FlightReference, dt_s: float) -> FlightCommand:
        gains = load_gains("s3")
        ax = self.acceleration(0, want.x_m - seen.x_m, want.speed_m_s, seen.vx_m_s, dt_s)
        limit = gains.position.pitch_limit_rad
        pitch = limited(ax / 9.81, limit)
        rate = limited(2.9 * (pitch - seen.pitch_rad), gains.attitude.rate_limit_rad_s)
        torque = self.inertias[1] * 7.4 * (rate - seen.q_rad_s)
        self.climb += (want.z_m - seen.z_m) * dt_s
        up = limited(4.0 * (want.z_m - seen.z_m) - 3.2 * seen.vz_m_s + self.climb, 4.0)
        lift = self.mass * (9.81 + up) / (cos(seen.pitch_rad) * cos(seen.roll_rad))
        return FlightCommand(lift, 0.0, torque, 0.0)


class Hover:
    """Carry the weight and note what is seen."""

    def __init__(self) -> None:
        self.seen: list[tuple[FlightMeasurement, FlightReference]] = []

    def step(self, seen: FlightMeasurement, want: FlightReference, dt_s: float) -> Any:
        assert dt_s == 0.004
        self.seen.append((seen, want))
        return want.hover_N, 0.0, 0.0, 0.0


def test_the_same_law_in_python_gives_the_same_flight():
    flown = case(duration_s=25.0, log_Hz=250.0)
    own, built_in = fly_user_controller(flown, Cascade(), "tests:Cascade"), fly(flown)
    assert own.user_controller == "tests:Cascade"
    assert built_in.user_controller == ""
    for name in ("x_m", "z_m", "pitch_rad", "speed1_rad_s", "coverage1", "pitch_ground_Nm"):
        np.testing.assert_allclose(own[name], built_in[name], rtol=0.0, atol=1e-9, err_msg=name)
    assert np.abs(own["pitch_rad"]).max() > np.radians(5.0)  # it has met the wall
    assert np.isnan(own["pitch_ref_rad"]).all()  # of a law that nobody knows


def test_it_sees_the_map_with_its_errors_and_the_gyro_with_its_noise():
    over = replace(SHORT, start_m=(2.8, 0.0, 0.24), goals=(Goal(x_m=2.8, z_m=0.24),))
    true, wrong, noisy = Hover(), Hover(), Hover()
    fly_user_controller(over, true, "h")
    fly_user_controller(replace(over, map_offset_m=(-0.9, 0.0, -0.01)), wrong, "h")
    fly_user_controller(replace(over, gyro_noise_rad_s=0.015), noisy, "h")
    first, want = true.seen[0]
    assert first.coverage == pytest.approx((0.63, 0.0, 0.0, 0.0), abs=0.01)
    assert first.height_m == (pytest.approx(0.24), inf, inf, inf)
    assert (first.x_m, first.z_m) == (2.8, 0.24)
    assert want.hover_N == pytest.approx(1.4 * 9.81)
    assert wrong.seen[0][0].coverage == (1.0, 1.0, 1.0, 1.0)
    assert wrong.seen[0][0].height_m == pytest.approx((0.25,) * 4)
    noise = [seen.r_rad_s for seen, _ in noisy.seen[:60]]
    assert 0.008 < np.std(noise) < 0.024
    assert true.seen[1][0].time_s == 0.004


def test_what_it_divides_by_takes_the_ground_effect_away():
    class Divides(Hover):
        def step(self, seen: FlightMeasurement, want: FlightReference, dt_s: float) -> Any:
            return FlightCommand(want.hover_N, 0.0, 0.0, 0.0, (1.25,) * 4)

    free = replace(SHORT, below=Environment())
    lighter = fly_user_controller(free, Divides(), "d")
    np.testing.assert_allclose(lighter["vz_m_s"][-1], -0.2 * 9.81 * 0.38, rtol=1e-6)
    np.testing.assert_allclose(fly_user_controller(free, Hover(), "h")["vz_m_s"], 0.0, atol=1e-12)


class Returns:
    """Return always the same."""

    def __init__(self, what: Any) -> None:
        self.what = what

    def step(self, seen: FlightMeasurement, want: FlightReference, dt_s: float) -> Any:
        return self.what


@pytest.mark.parametrize(
    ("what", "says"),
    [
        (FlightCommand(nan, 0.0, 0.0, 0.0), "returned thrust_N = nan at 0 s"),
        (FlightCommand(14.0, 0.0, -inf, 0.0), "returned pitch_Nm = -inf"),
        (FlightCommand(14.0, "0", 0.0, 0.0), "returned roll_Nm = '0'"),  # type: ignore[arg-type]
        (14.0, "returned a command = 14.0"),
        (None, "returned a command = None"),
        ((14.0, 0.0, 0.0), "returned a command = (14.0, 0.0, 0.0)"),
        (np.zeros(3), "returned a command = array([0., 0., 0.])"),
        (FlightCommand(14.0, 0.0, 0.0, 0.0, (1.0, 1.0)), "returned divide_by = (1.0, 1.0)"),
        (FlightCommand(14.0, 0.0, 0.0, 0.0, (1.0, 1.0, nan, 1.0)), "returned divide_by"),
        (FlightCommand(14.0, 0.0, 0.0, 0.0, (0.0,) * 4), "4 finite factors above 0"),
    ],
)
def test_what_is_no_command_is_refused_with_file_and_line(what, says):
    with pytest.raises(InputError) as caught:
        fly_user_controller(SHORT, Returns(what), "r")
    message = str(caught.value)
    assert says in message
    assert "test_flight_own.py line" in message
    assert "\n" not in message


def test_a_class_that_needs_arguments_is_refused():
    with pytest.raises(InputError, match=r"without arguments.*test_flight_own\.py line"):
        make_controller(Returns, "tests:Returns")
