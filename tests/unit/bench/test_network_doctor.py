"""Findings for network addresses, on sockets of this computer."""

from __future__ import annotations

import socket

import pytest

from benchtool.bench.doctor.causes import network_findings, serial_port_of
from benchtool.core.errors import InputError


@pytest.mark.parametrize(
    ("text", "port"),
    [
        ("/dev/ttyUSB0", "/dev/ttyUSB0"),
        ("COM12", "COM12"),
        ("", ""),
        ("/dev/serial/by-id/usb-1:1.0-port0", "/dev/serial/by-id/usb-1:1.0-port0"),
        ("serial:/dev/ttyUSB0?baud=500000", "/dev/ttyUSB0"),
        ("mavlink:serial:/dev/ttyACM0:57600?system=1", "/dev/ttyACM0"),
        ("mavlink:udpin:14550", None),
        ("tcp:127.0.0.1:5555", None),
        ("rcbudp:127.0.0.1:55047", None),
    ],
)
def test_the_port_of_an_address(text: str, port: str | None) -> None:
    assert serial_port_of(text) == port


def test_an_address_without_a_port_is_refused() -> None:
    with pytest.raises(InputError, match="has no port to look at"):
        serial_port_of("sim:pquad")


def test_a_udp_port_in_use_is_a_problem() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own:
        own.bind(("127.0.0.1", 0))
        port = own.getsockname()[1]
        (finding,) = network_findings(f"mavlink:udpin:127.0.0.1:{port}")
        assert finding.verdict == "problem"
        assert f"another program listens on UDP 127.0.0.1:{port}" in finding.sentence
        ours, theirs = network_findings(f"rcbudp:127.0.0.1:55047?listen={port}")
    assert ours.verdict == "problem"
    assert theirs.verdict == "not checked"
    (finding,) = network_findings(f"mavlink:udpin:127.0.0.1:{port}")
    assert (finding.verdict, finding.sentence) == ("ok", f"UDP 127.0.0.1:{port} is free")


def test_a_tcp_port_is_tried() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        assert network_findings(f"tcp:127.0.0.1:{port}")[0].verdict == "ok"
    (finding,) = network_findings(f"mavlink:tcp:127.0.0.1:{port}")
    assert finding.verdict == "problem"
    assert "nobody answers at TCP" in finding.sentence


def test_a_host_that_nobody_knows_and_an_address_of_others() -> None:
    (unknown,) = network_findings("tcp:no-such-host.invalid:5555")
    assert unknown.sentence == "the host 'no-such-host.invalid' is not known"
    (foreign,) = network_findings("mavlink:udpin:192.0.2.1:14550")
    assert foreign.verdict == "problem"
    assert "cannot listen on UDP 192.0.2.1:14550" in foreign.sentence
