from __future__ import annotations

from hashlib import sha256
from pathlib import Path

import pytest

from benchtool.bench.addresses import MavlinkAddress
from benchtool.bench.mavlink.settings import (
    MotorMap,
    read_key,
    settings_of,
)
from benchtool.core.errors import InputError


def test_listening_wider_than_this_computer_is_said_aloud() -> None:
    def warning(place: str) -> str:
        return settings_of(MavlinkAddress.parse(f"mavlink:{place}")).warning

    assert warning("udpin:14550") == warning("udpin:localhost:14550") == ""
    assert warning("udpout:192.168.4.1:14550") == ""
    assert warning("udpin:0.0.0.0:14550").startswith("listening on 0.0.0.0: any computer")


def test_options(tmp_path: Path) -> None:
    made = MotorMap(rig="pquad", autopilot="PX4", motors=(2, 1), outputs=(1, 2), escs=(0, 2))
    path = tmp_path / "pquad.motors.toml"
    path.write_text(made.to_toml())
    options = f"system=7&map={path}&thrust=cell.z&thrust_scale=-0.5&rpm=none&cell=COM3:38400"
    found = settings_of(MavlinkAddress.parse(f"mavlink:udpin:14550?{options}"))
    assert found.system == 7
    assert found.motor_map == made
    assert found.thrust.message == "DEBUG_VECT"
    assert (found.thrust_scale_N, found.speeds, found.cell) == (-0.5, False, ("COM3", 38400))
    assert not found.distance
    pitch = settings_of(MavlinkAddress.parse("mavlink:udpin:14550?mode=pitch"))
    assert pitch.distance
    assert pitch.rate_Hz == 250.0  # the loop on board is followed, a motor test is looked at
    assert settings_of(MavlinkAddress.parse("mavlink:udpin:14550")).rate_Hz == 50.0


def test_keys(tmp_path: Path) -> None:
    path, key = tmp_path / "key", bytes(range(32))
    for data, read in (
        (key, key),
        (key.hex().encode() + b"\n", key),
        (b"correct horse\n", sha256(b"correct horse").digest()),
    ):
        path.write_bytes(data)
        assert read_key(path) == read
    path.write_text("\n")
    with pytest.raises(InputError, match="is empty"):
        read_key(path)
