"""Lines of the RCbenchmark bridge: values in the channel's units, and what is no such line."""

from __future__ import annotations

import json
from math import isnan, nan
from typing import Any

import pytest

from benchtool.bench.rcbenchmark.lines import BridgeDecoder, StandClock, bridge_text, pulse_text
from benchtool.core.errors import InputError, ProtocolError
from benchtool.core.rig_file import rig_named

ENTRY = {"bridge": 1, "n": 7, "t_ms": 1250.5, "us": 1400, "why": ""}


def said(**readings: tuple[object, str]) -> bytes:
    """Give a line as script and GUI make it: cut to bytes, so the dot of N·m is Latin 1."""
    entries = {
        name: {"workingValue": value, "workingUnit": unit, "displayValue": 0, "displayUnit": "?"}
        for name, (value, unit) in readings.items()
    }
    return json.dumps({"benchtool": ENTRY, **entries}, ensure_ascii=False).encode("latin-1") + b"\n"


def test_working_values_are_read_in_whatever_unit_they_come() -> None:
    line = said(
        time=(12.5, "s"), thrust=(1000.0, "g"), torque=(0.12, "N·m"), voltage=(11.1, "V"),
        current=(4.0, "A"), motorOpticalSpeed=(5000, "RPM"), vibration=(2.0, "g"),
    )  # fmt: skip
    (told,) = BridgeDecoder().feed(line)
    assert told.entry.n == 7
    assert told.time_s == 12.5
    assert told.values["thrust_N"] == pytest.approx(9.80665)
    assert told.values["torque_Nm"] == 0.12
    assert told.values["rpm1"] == pytest.approx(5000.0)
    assert told.values["pwm1_us"] == 1400.0
    assert told.values["vibration_m_s2"] == pytest.approx(19.6133)
    assert isnan(told.values["plate_z_m"])


@pytest.mark.parametrize(
    ("given", "newtons"),
    [
        ((2.0, "kgf"), 19.6133),
        ((3.0, "N"), 3.0),
        ((1.0, "lbf"), 4.44822),
        ((500.0, "gf"), 4.903325),
        ((None, "g"), nan),
        (("", "N"), nan),
    ],
)
def test_thrust_comes_in_several_units(given: tuple[object, str], newtons: float) -> None:
    (told,) = BridgeDecoder().feed(said(thrust=given))
    assert told.values["thrust_N"] == pytest.approx(newtons, rel=1e-5, nan_ok=True)


def test_a_reading_in_a_unit_of_something_else_is_refused() -> None:
    with pytest.raises(ProtocolError, match="thrust in 'RPM', which is no known unit of it"):
        BridgeDecoder().feed(said(thrust=(1.0, "RPM")))


def test_lines_come_in_pieces_and_several_at_once() -> None:
    ear, line = BridgeDecoder(), said(thrust=(1.0, "g"))
    assert ear.feed(line[:40]) == []
    assert len(ear.feed(line[40:] + line)) == 2


def test_the_makers_example_is_told_from_the_bridge() -> None:
    ear = BridgeDecoder()
    assert ear.feed(b'{"thrust": {"workingValue": 1, "workingUnit": "g"}}') == []
    assert (ear.foreign, ear.corrupt) == (1, 0)
    assert ear.feed(b"Hi from RCbenchmark script!\n") == []
    assert (ear.foreign, ear.corrupt) == (1, 1)


HELLO = {
    "to": "hello", "board": "b", "version": "v", "firmware": "f", "output": "esc", "speed": "s",
    "low_us": 1000, "high_us": 2000, "silence_ms": 250, "ramp_ms": 500, "limits": {"thrust_N": 12},
    "bridge": 1, "t_ms": 0, "us": 1000,
}  # fmt: skip


@pytest.mark.parametrize(
    ("entry", "says"),
    [
        ({**ENTRY, "us": None}, "us is null"),
        ({**ENTRY, "us": [1]}, "us is"),
        ({**ENTRY, "t_ms": "x"}, "t_ms is"),
        ({**ENTRY, "n": True}, "n is true"),
        ({"bridge": 1, "n": 1, "us": 1000}, "t_ms is missing"),
        ({**HELLO, "limits": []}, "limits is"),
        ({**HELLO, "limits": {"thrust_N": -1}}, "limits.thrust_N is -1"),
        ({**HELLO, "silence_ms": "x"}, "silence_ms is"),
        ({**HELLO, "silence_ms": 0}, "silence_ms is 0"),
        ({**HELLO, "high_us": 1e300}, "high_us is"),
        ({key: value for key, value in HELLO.items() if key != "low_us"}, "low_us is missing"),
    ],
    ids=str,
)
def test_a_line_out_of_its_ranges_is_refused(entry: dict[str, object], says: str) -> None:
    with pytest.raises(ProtocolError, match=says):
        BridgeDecoder().feed(json.dumps({"benchtool": entry}).encode() + b"\n")


@pytest.mark.parametrize("line", [b"[" * 3000, b"1" * 4400, b'{"benchtool":{"us":NaN}}'])
def test_a_line_beyond_the_bounds_of_json_is_corrupt(line: bytes) -> None:
    ear = BridgeDecoder()
    assert ear.feed(line + b"\n") == []
    assert ear.corrupt == 1


def test_another_version_of_the_script_is_refused() -> None:
    with pytest.raises(ProtocolError, match="version 9, this program needs 1; write it anew"):
        BridgeDecoder().feed(b'{"benchtool": {"bridge": 9}}\n')


def test_pulses_go_out_as_ascii() -> None:
    assert [pulse_text(1500.0), pulse_text(1500.25)] == [b"1500", b"1500.25"]


def test_device_time_never_runs_backwards() -> None:
    clock = StandClock()
    given = [(10.0, 0.0), (10.02, 20.0), (10.02, 41.0), (0.5, 61.0), (0.52, 80.0)]
    times_us = [clock.time_us(stand_s, script_ms) for stand_s, script_ms in given]
    # The stand's own steps; the script's where the stand repeats itself or begins anew.
    assert times_us == [1, 20_001, 41_001, 61_001, 81_001]


def test_a_stand_without_time_goes_by_the_script() -> None:
    clock = StandClock()
    assert [clock.time_us(float("nan"), ms) for ms in (5.0, 30.0, 55.0)] == [1, 25_001, 50_001]


RIG = rig_named("pquad_single")


def test_the_rig_and_the_ports_stand_at_its_head() -> None:
    text = bridge_text(RIG, "electrical", listen_port=5000, host_port=5001)
    for line in (
        "var LISTEN_PORT = 5000;",
        'var HOST = "127.0.0.1";',
        "var HOST_PORT = 5001;",
        'var SPEED = "motorElectricalSpeed";',
        "var LOWEST_US = 1000;",
        "var HIGHEST_US = 1950;",
        'var LIMITS = {"thrust_N": 12.0, "rpm": 9800.0, "current_A": 30.0, "voltage_min_V": 9.6};',
    ):
        assert line in text
    assert "@" not in text


@pytest.mark.parametrize(
    ("rig", "place", "speed", "said"),
    [
        ("pquad", {}, "optical", "has 4 rotors, and the bridge drives one ESC"),
        ("pquad_single", {"listen_port": 0}, "optical", "outside 1 to 65535"),
        ("pquad_single", {"host": "lab-pc"}, "optical", "'lab-pc' is no IPv4 address"),
        ("pquad_single", {"host_port": 55047}, "optical", "cannot both listen on port 55047"),
        ("pquad_single", {}, "acoustic", "known: electrical, optical"),
    ],
)
def test_what_no_bridge_can_serve_is_refused(
    rig: str, place: dict[str, Any], speed: str, said: str
) -> None:
    with pytest.raises(InputError, match=said):
        bridge_text(rig_named(rig), speed, **place)
