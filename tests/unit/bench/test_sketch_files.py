"""The firmware's files: complete, with the rig's numbers, and refused where they cannot be."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest

from benchtool.bench.serial.sketch_files import BOARDS, board_named, sketch_files
from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.rig_file import rig_named

RIG = rig_named("pquad_single")


def test_every_blank_is_filled_in() -> None:
    for board in BOARDS:
        files = sketch_files(board, RIG, "bench-01", "my_bench")
        assert "my_bench.ino" in files
        for name, text in files.items():
            assert not re.search(r"@[A-Z_]+@", text), name
            assert text.endswith("\n"), name


def test_settings_are_those_of_the_rig() -> None:
    settings = sketch_files(board_named("uno"), RIG, "bench-01", "bench")["settings.h"]
    defined = dict(re.findall(r"^#define (\w+) (\S+)", settings, re.MULTILINE))
    assert defined["DEVICE_NAME"] == '"bench-01"'
    assert float(defined["LIMIT_THRUST_N"]) == RIG.limits.thrust_N
    assert float(defined["LIMIT_RPM"]) == RIG.limits.rpm
    assert float(defined["LIMIT_VOLTAGE_MIN_V"]) == RIG.limits.voltage_min_V
    assert float(defined["LIMIT_PWM_US"]) == RIG.limits.pwm_us
    assert float(defined["PWM_STOP_US"]) == RIG.propulsion.pwm_stop_us
    assert float(defined["PWM_IDLE_US"]) == RIG.propulsion.pwm_start_us
    assert defined["MOTORS"] == "1"


def test_the_sources_stay_small() -> None:
    lengths = [
        len(text.splitlines())
        for text in sketch_files(board_named("uno"), RIG, "bench-01", "bench").values()
    ]
    assert max(lengths) <= 260


def test_what_cannot_be_is_refused() -> None:
    uno = board_named("uno")
    with pytest.raises(UnknownChoice, match="known: nano, uno"):
        board_named("due")
    with pytest.raises(InputError, match="has 4 motors"):
        sketch_files(uno, rig_named("pquad"), "bench-01", "bench")
    with pytest.raises(InputError, match="cannot be a device name"):
        sketch_files(uno, RIG, 'bench"', "bench")
    with pytest.raises(InputError, match="cannot be a folder name"):
        sketch_files(uno, RIG, "bench-01", "my bench")
    digital = replace(RIG, limits=replace(RIG.limits, pwm_us=3000.0))
    with pytest.raises(InputError, match=r"limits\.pwm_us of rig .* is 3000 us"):
        sketch_files(uno, digital, "bench-01", "bench")
