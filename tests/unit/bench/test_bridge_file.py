"""The bridge script for the RCbenchmark GUI: a rig's numbers, and rigs that it cannot serve."""

from __future__ import annotations

from typing import Any

import pytest

from benchtool.bench.rcbenchmark.lines import bridge_text
from benchtool.core.errors import InputError
from benchtool.core.rig_file import rig_named

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
        (
            "pquad_single",
            {"host_port": 55047},
            "optical",
            "cannot both listen on port 55047",
        ),
        ("pquad_single", {}, "acoustic", "known: electrical, optical"),
    ],
)
def test_what_no_bridge_can_serve_is_refused(
    rig: str, place: dict[str, Any], speed: str, said: str
) -> None:
    with pytest.raises(InputError, match=said):
        bridge_text(rig_named(rig), speed, **place)
