"""The firmware's files: complete, with the rig's numbers, and refused where they cannot be."""

from __future__ import annotations

import re

from benchtool.bench.serial.sketch import sketch_files
from benchtool.core.rig_file import load_rig_by_name

RIG = load_rig_by_name("pquad_single")


def test_settings_are_those_of_the_rig():
    settings = sketch_files("uno", RIG, "bench-01", "bench")["settings.h"]
    defined = dict(re.findall(r"^#define (\w+) (\S+)", settings, re.MULTILINE))
    assert defined["DEVICE_NAME"] == '"bench-01"'
    assert float(defined["LIMIT_THRUST_N"]) == RIG.limits.thrust_N
    assert float(defined["LIMIT_RPM"]) == RIG.limits.rpm
    assert float(defined["LIMIT_VOLTAGE_MIN_V"]) == RIG.limits.voltage_min_V
    assert float(defined["LIMIT_PWM_US"]) == RIG.limits.pwm_us
    assert float(defined["PWM_STOP_US"]) == RIG.propulsion.pwm_stop_us
    assert float(defined["PWM_IDLE_US"]) == RIG.propulsion.pwm_start_us
    assert defined["MOTORS"] == "1"
