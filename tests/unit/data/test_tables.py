"""Foreign tables: a column map, known names, a Crazyflie, a propeller."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.core.errors import FileFormatError, InputError, UnknownChoice
from benchtool.data.column_map import find_conversion
from tests.unit.data.stand_logs import found, imported

FLIGHT_STAND = "Time;Load [ozf];Torque (ozf in);Speed;Note\n0,0;1,5;0,1;50;a\n0,5;2,5;0,2;60;b\n"
MAP = """
[columns]
time_s = "Time"
thrust_N = { column = "Load [ozf]", unit = "ozf", sign = -1 }
torque_Nm = { column = "Torque (ozf in)", unit = "ozf*in" }
rpm1 = { column = "Speed", unit = "Hz", factor = 0.5 }
temperature_degC = { constant = 68, unit = "degF" }
"""
OUNCE_N = 0.45359237 / 16 * 9.80665


def test_a_column_map_with_units_that_only_pint_knows(tmp_path):
    (tmp_path / "map.toml").write_text(MAP)
    read = imported(FLIGHT_STAND, columns=tmp_path / "map.toml")
    recording = read.recording
    np.testing.assert_allclose(recording.column("thrust_N"), [-1.5 * OUNCE_N, -2.5 * OUNCE_N])
    np.testing.assert_allclose(
        recording.column("torque_Nm"), [0.1 * OUNCE_N * 0.0254, 0.2 * OUNCE_N * 0.0254]
    )
    np.testing.assert_allclose(recording.column("rpm1"), [1500.0, 1800.0])
    np.testing.assert_allclose(recording.column("temperature_degC"), 20.0)
    assert found(read, "columns")[0].words == "not in the map: Note"
    assert read.sources["rpm1"] == "Speed [Hz] times 0.5"


@pytest.mark.parametrize(
    ("text", "target", "factor"),
    [
        ("Hz", "rpm", 60.0),
        ("rad/s", "rpm", 60.0 / (2.0 * np.pi)),
        ("g", "N", 9.80665e-3),
        ("g", "m/s2", 9.80665),
        ("µs", "pwm_us", 1.0),
        ("kPa", "Pa", 1000.0),
        ("%", "1", 0.01),
        ("ft", "m", 0.3048),
    ],
)
def test_units(text, target, factor):
    assert find_conversion(text, target).factor == pytest.approx(factor, rel=1e-12)


def test_units_in_a_header_are_read_and_those_of_another_dimension_are_refused():
    recording = imported("Dist (cm),n,Thrust_kg,n_Hz\n5,7,2,100\n").recording
    assert recording.values[0].tolist() == pytest.approx([0.05, 2.0 * 9.80665, 6000.0])
    with pytest.raises(FileFormatError, match="not a unit of force"):
        imported("t,Thrust (V)\n0,1\n")
    with pytest.raises(UnknownChoice, match="known: "):
        imported("t,Thrust (N)\n0,1\n", tare=("lift",))


def test_a_crazyflie_lifts_in_gram_force():
    read = imported("pwm,vbat[V],rpm1,rpm2,rpm3,rpm4, weight\n100,4.0,9,9,9,9,22.5\n")
    assert read.format == "Crazyflie system_id"
    assert read.recording.column("thrust_N")[0] == pytest.approx(22.5 * 9.80665e-3)
    assert read.recording.column("pwm_raw")[0] == 100.0
    assert "pwm1_us" not in read.recording
    assert found(read, "unit")[0].kind == "doubt"


def test_a_propellers_coefficients_become_thrust_and_torque():
    text = "RPM    CT       CP\n6000   0.1000   0.0500\n3000   0.0900   0.0600\n"
    read = imported(text, "/data/apcsf_10x7_static_kt0827.txt", air_density_kg_m3=1.2)
    diameter_m, turns = 0.254, np.array([100.0, 50.0])
    thrust = np.array([0.1, 0.09]) * 1.2 * turns**2 * diameter_m**4
    np.testing.assert_allclose(read.recording.column("thrust_N"), thrust)
    power = np.array([0.05, 0.06]) * 1.2 * turns**3 * diameter_m**5
    np.testing.assert_allclose(read.recording.column("torque_Nm"), power / (2 * np.pi * turns))
    assert found(read, "air density") == []
    assert found(imported(text, "x_10x7_static.txt"), "air density")[0].kind == "doubt"
    with pytest.raises(FileFormatError, match="file name contains no diameter"):
        imported(text, "static.txt")


def test_windows_are_marked_by_the_user():
    from benchtool.data.repairs.flight_windows import parse_window

    text = "time_s,pwm1_us,pwm2_us\n" + "".join(f"{i},1500,1500\n" for i in range(10))
    read = imported(text, over=(parse_window("2:4:1"), parse_window("6:7:all")))
    assert np.flatnonzero(read.recording.column("coverage1")).tolist() == [2, 3, 4, 6, 7]
    assert np.flatnonzero(read.recording.column("coverage2")).tolist() == [6, 7]
    for wrong in ("1:2", "a:b:c", "5:4:1", "-1:2:1", "1:inf:1", "1:2:-3"):
        with pytest.raises(InputError, match="START:END:ROTOR"):
            parse_window(wrong)
    with pytest.raises(InputError, match=r"END 2 s is not after START 4 s"):
        parse_window("4:2:1")
    with pytest.raises(InputError, match="START is -1 s; allowed: from 0 s"):
        parse_window("-1:2:1")
    with pytest.raises(InputError, match="has rotors 1, 2"):
        imported(text, over=(parse_window("1:2:3"),))
    with pytest.raises(InputError, match="allowed: up to 9 s"):
        imported(text, over=(parse_window("20:30:1"),))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('thrust_N = { column = "Load", unit = "N" }', "lacks"),
        ('lift_N = "Load [ozf]"', "unknown channel"),
        ('thrust_N = { column = "Load [ozf]", unit = "furlong" }', "not a unit of force"),
        ('thrust_N = { column = "Load [ozf]", unit = "wibble" }', "is unknown"),
        ('thrust_N = { column = "Load [ozf]", colour = "red" }', "colour"),
        ("thrust_N = 5", "write it as"),
        ("[columns]", "the map is empty"),
        ("thrust_N = ", "not valid TOML"),
    ],
)
def test_a_map_that_cannot_hold_is_refused(tmp_path, text, message):
    (tmp_path / "map.toml").write_text(text)
    with pytest.raises(InputError, match=message):
        imported(FLIGHT_STAND, columns=tmp_path / "map.toml")
