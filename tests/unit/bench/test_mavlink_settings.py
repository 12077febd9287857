from __future__ import annotations

from hashlib import sha256
from pathlib import Path

import pytest

from benchtool.bench.addresses import MavlinkAddress
from benchtool.bench.mavlink.settings import (
    MotorMap,
    read_key,
    read_motor_map,
    settings_of,
    transport_of,
)
from benchtool.bench.transport.serial_port import SerialPort
from benchtool.bench.transport.sockets import TcpSocket, UdpSocket
from benchtool.core.errors import FileFormatError, InputError, PortBusy, UnknownChoice


def test_links() -> None:
    udp = transport_of(MavlinkAddress.parse("mavlink:udpin:14550"))
    assert isinstance(udp, UdpSocket)
    assert (udp.host, udp.port) == ("127.0.0.1", 14550)
    assert isinstance(transport_of(MavlinkAddress.parse("mavlink:tcp:127.0.0.1:5760")), TcpSocket)
    port = transport_of(MavlinkAddress.parse("mavlink:serial:/dev/ttyACM0:57600"))
    assert isinstance(port, SerialPort)
    assert (port.port, port.baud) == ("/dev/ttyACM0", 57600)
    assert transport_of(MavlinkAddress.parse("mavlink:serial:COM12")).baud == 115_200


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


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('rig = "a"\nautopilot = "b"\nmotors = [1, 1]\noutputs = [1, 2]\nescs = [1, 2]', "twice"),
        ('rig = "a"\nautopilot = "b"\nmotors = [1]\noutputs = [1, 2]\nescs = [1]', "equally long"),
        ('rig = "a"\nautopilot = "b"\nmotors = [0]\noutputs = [1]\nescs = [1]', "motors"),
    ],
)
def test_maps_that_make_no_sense_are_refused(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "map.toml"
    path.write_text(text)
    with pytest.raises(FileFormatError, match=said):
        read_motor_map(path)


def test_a_map_with_an_unknown_key_names_the_known_ones(tmp_path: Path) -> None:
    path = tmp_path / "map.toml"
    path.write_text('rig = "a"\nmotor = [1]')
    with pytest.raises(UnknownChoice, match="known: autopilot, escs, motors, outputs, rig"):
        read_motor_map(path)


def test_a_udp_port_in_use_is_told() -> None:
    first = UdpSocket("127.0.0.1", 0, listen=True)
    first.open()
    assert first._socket is not None
    port = first._socket.getsockname()[1]
    with pytest.raises(PortBusy, match=r"another program listens on UDP .* \(a ground station"):
        UdpSocket("127.0.0.1", port, listen=True).open()
    first.close()


def test_two_ends_of_udp_hear_each_other() -> None:
    near = UdpSocket("127.0.0.1", 0, listen=True)
    near.open()
    assert near._socket is not None
    far = UdpSocket("127.0.0.1", near._socket.getsockname()[1], listen=False)
    far.open()
    far.write(b"hello")
    assert near.read(1.0) == b"hello"
    near.write(b"there")
    assert far.read(1.0) == b"there"
    near.close()
    far.close()
