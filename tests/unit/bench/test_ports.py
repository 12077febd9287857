"""Serial ports: list, answer to a hello, and findings for made-up surroundings."""

import socket
from dataclasses import replace
from types import SimpleNamespace

import pytest

from benchtool.bench.ports import (
    HostEnvironment,
    Port,
    findings,
    identify_port,
    network_findings,
    parse_serial_port,
    serial_ports,
)
from benchtool.bench.transport.transport import Holder
from benchtool.core.errors import InputError
from benchtool.core.rig_file import rig_named
from benchtool.physics.model_file import load_model
from benchtool.virtual.devices import hello_of, virtual_plant
from benchtool.virtual.firmware import Firmware
from tests.doubles.loopback_link import LoopbackLink


def test_ports_come_in_natural_order_and_phantoms_are_left_out(monkeypatch):
    def item(device, hwid="USB", vid=0x0403, pid=0x6001, serial_number=None):
        return SimpleNamespace(
            device=device,
            description="n/a",
            hwid=hwid,
            vid=vid,
            pid=pid,
            serial_number=serial_number,
        )

    present = [
        item("COM12", serial_number="X"),
        item("COM3"),
        item("COM1", hwid="n/a", vid=None, pid=None),
        item("COM2", hwid="ACPI\\PNP0501", vid=None, pid=None),
    ]
    monkeypatch.setattr("serial.tools.list_ports.comports", lambda: present)
    found = serial_ports()
    assert [port.name for port in found] == ["COM2", "COM3", "COM12"]
    assert [port.usb for port in found] == ["", "0403:6001", "0403:6001"]
    assert [port.serial_number for port in found] == ["", "", "X"]
    assert found[0].description == ""


def test_a_bench_that_answers_is_named():
    rig = rig_named("pquad")
    truth = load_model("quad_body_lift", rig).model
    plant = virtual_plant(rig, truth, 4)
    link = LoopbackLink(Firmware(plant, hello_of(plant, truth, 4)), lambda: plant.rate_Hz)
    answer = identify_port(link, "COM3", link.clock)
    assert answer.kind == "bench"
    assert answer.text.startswith("virtual-pquad-4, benchtool virtual bench")
    assert answer.text.endswith("4 rotors, virtual")


FTDI = Port(name="/dev/ttyUSB0", vendor=0x0403, product=0x6001)
LINUX = HostEnvironment(
    system="Linux",
    port=FTDI.name,
    ports=(FTDI,),
    exists=True,
    may_open=True,
    group="dialout",
    user="ada",
    groups=frozenset({"ada", "dialout"}),
    groups_on_file=frozenset({"dialout"}),
    holders=(),
)
MAC = replace(
    LINUX,
    system="Darwin",
    port="/dev/cu.usbserial-1",
    ports=(replace(FTDI, name="/dev/cu.usbserial-1"),),
    holders=None,
)
WINDOWS = HostEnvironment(system="Windows", port="COM12", ports=(replace(FTDI, name="COM12"),))
BASES = {
    "linux": LINUX,
    "mac": MAC,
    "windows": WINDOWS,
    "bare": HostEnvironment(system="Linux"),
    "terminal": replace(LINUX, holders=(Holder(99, "python", is_terminal=True),)),
}
FOUND = """
linux | port | ok | is there
linux | permission | ok | ada may open
linux | other users | ok | no program
linux may_open=no groups= groups_on_file= | permission | problem | -aG dialout ada
linux may_open=no groups=ada | permission | problem | log out and in again
linux port=/dev/ttyUSB7 exists=no | port | problem | present: /dev/ttyUSB0
bare | port | problem | `benchtool bench serve` makes a virtual bench
linux holders=minicom:812 | other users | problem | minicom (pid 812)
terminal | other users | ok | python (pid 99)
mac port=/dev/tty.usbserial-1 | port | problem | use /dev/cu.usbserial-1
mac | other users | not checked | Darwin does not report
windows | permission | not checked | every user
windows | other users | not checked | Windows does not report
windows port=com12 | port | ok | is there
windows port=\\\\.\\COM12 | port | ok | is there
"""
"""Facts about a port, and of one cause the verdict and some words."""


def value_of(key, text):
    if key == "holders":
        name, _, pid = text.partition(":")
        return (Holder(int(pid), name),)
    if key in ("groups", "groups_on_file"):
        return frozenset(filter(None, text.split(",")))
    return {"yes": True, "no": False}.get(text, text)


@pytest.mark.parametrize("row", FOUND.strip().split("\n"))
def test_what_is_found(row):
    around, name, verdict, words = row.split(" | ")
    base, *pairs = around.split(" ")
    changes = {key: value_of(key, text) for key, _, text in (pair.partition("=") for pair in pairs)}
    (hit,) = (item for item in findings(replace(BASES[base], **changes)) if item.name == name)
    assert hit.verdict == verdict
    assert words in f"{hit.sentence} {hit.fix}"


@pytest.mark.parametrize(
    ("text", "port"),
    [
        ("COM12", "COM12"),
        ("", ""),
        ("/dev/serial/by-id/usb-1:1.0-port0", "/dev/serial/by-id/usb-1:1.0-port0"),
        ("serial:/dev/ttyUSB0?baud=500000", "/dev/ttyUSB0"),
        ("mavlink:serial:/dev/ttyACM0:57600?system=1", "/dev/ttyACM0"),
        ("mavlink:udpin:14550", None),
        ("tcp:127.0.0.1:5555", None),
    ],
)
def test_the_port_of_an_address(text, port):
    assert parse_serial_port(text) == port


def test_an_address_without_a_port_is_refused():
    with pytest.raises(InputError, match="has no port to look at"):
        parse_serial_port("sim:pquad")


def test_a_udp_port_in_use_is_a_problem():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own:
        own.bind(("127.0.0.1", 0))
        port = own.getsockname()[1]
        (finding,) = network_findings(f"mavlink:udpin:127.0.0.1:{port}")
        assert finding.verdict == "problem"
        assert f"another program listens on UDP 127.0.0.1:{port}" in finding.sentence
    (other,) = network_findings(f"mavlink:udpout:127.0.0.1:{port}")
    assert other.verdict == "not checked"
    (finding,) = network_findings(f"mavlink:udpin:127.0.0.1:{port}")
    assert (finding.verdict, finding.sentence) == ("ok", f"UDP 127.0.0.1:{port} is free")


def test_a_tcp_port_is_tried():
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        assert network_findings(f"tcp:127.0.0.1:{port}")[0].verdict == "ok"
    (finding,) = network_findings(f"mavlink:tcp:127.0.0.1:{port}")
    assert finding.verdict == "problem"
    assert f"127.0.0.1:{port}" in finding.sentence
    (unknown,) = network_findings("tcp:no-such-host.invalid:5555")
    assert (unknown.verdict, "is not known" in unknown.sentence) == ("problem", True)
