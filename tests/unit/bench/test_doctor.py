"""Findings of the doctor, judged from surroundings that were made up for each platform."""

import socket
from dataclasses import replace

import pytest

from benchtool.bench.doctor.causes import (
    CAUSES,
    INSTALL_RULE,
    findings,
    network_findings,
    serial_port_of,
    udev_rule,
)
from benchtool.bench.doctor.ports import HostEnvironment, Port, probe_environment
from benchtool.bench.transport.transport import Holder
from benchtool.core.errors import InputError

FTDI = Port(
    name="/dev/ttyUSB0",
    description="FT232R USB UART",
    serial_number="A50285BI",
    vendor=0x0403,
    product=0x6001,
    by_id="/dev/serial/by-id/usb-FTDI_FT232R_USB_UART_A50285BI-if00-port0",
)
LINUX = HostEnvironment(
    system="Linux",
    port=FTDI.by_id,
    ports=(FTDI,),
    exists=True,
    may_open=True,
    group="dialout",
    user="ada",
    groups=frozenset({"ada", "dialout"}),
    groups_on_file=frozenset({"dialout"}),
    holders=(),
    programs=frozenset({"systemd", "bash"}),
    latency_ms=1,
    rule_installed=True,
    on_battery=False,
)
MAC = HostEnvironment(
    system="Darwin",
    port="/dev/cu.usbserial-A50285BI",
    ports=(replace(FTDI, name="/dev/cu.usbserial-A50285BI", by_id=""),),
    exists=True,
    may_open=True,
    group="wheel",
    user="ada",
    programs=frozenset({"finder"}),
)
WINDOWS = HostEnvironment(
    system="Windows",
    port="COM12",
    ports=(replace(FTDI, name="COM12", by_id=""),),
    programs=frozenset({"explorer.exe"}),
)
CH340 = Port(name="/dev/ttyUSB0", vendor=0x1A86, product=0x7523)
TWIN = replace(CH340, name="/dev/ttyUSB1")


@pytest.fixture(autouse=True)
def by_id_leads_to_the_port(monkeypatch):
    real = {FTDI.by_id: FTDI.name}
    monkeypatch.setattr(
        "benchtool.bench.doctor.ports.os.path.realpath",
        lambda path: real.get(path, path),
    )


def test_a_healthy_port_on_linux_has_nothing_to_mend():
    verdicts = {finding.name: finding.verdict for finding in findings(LINUX)}
    assert verdicts == dict.fromkeys(CAUSES, "ok") | {"computer sleep": "not checked"}


@pytest.mark.parametrize("healthy", [LINUX, MAC, WINDOWS])
def test_whatever_is_not_ok_says_what_to_do_or_why_it_was_not_tried(healthy):
    for finding in findings(healthy):
        assert finding.sentence
        if finding.verdict in ("warning", "problem"):
            assert finding.fix


LINKED = f"serial:{FTDI.by_id}"
BASES = {
    "linux": LINUX,
    "mac": MAC,
    "windows": WINDOWS,
    "bare": HostEnvironment(system="Linux"),
    "terminal": HostEnvironment(
        system="Linux",
        port="/dev/pts/3",
        exists=True,
        may_open=True,
        is_terminal=True,
        holders=(Holder(99, "python", is_terminal=True),),
        programs=frozenset({"modemmanager"}),
        rule_installed=False,
    ),
    "twins": replace(LINUX, port="/dev/ttyUSB0", ports=(CH340, TWIN), latency_ms=None),
}
FOUND = f"""
linux may_open=no groups= groups_on_file= rule_installed=no | permission | problem | -aG dialout ada
linux may_open=no groups= groups_on_file= rule_installed=no | permission | problem | {INSTALL_RULE}
linux may_open=no groups=ada | permission | problem | log out and in again
linux port=/dev/ttyUSB7 exists=no | port | problem | present: /dev/ttyUSB0
bare | port | problem | `benchtool bench serve` makes a virtual bench
linux holders=minicom:812 | other users | problem | minicom (pid 812)
terminal | other users | ok | python (pid 99)
terminal | port grabbers | -
terminal | udev rule | -
linux programs=modemmanager rule_installed=no | port grabbers | warning | install the udev rule
linux programs=modemmanager rule_installed=yes | port grabbers | ok | ModemManager talks
linux programs=brltty | port grabbers | warning | remove brltty
linux programs=brltty,modemmanager rule_installed=no | port grabbers | warning | bench ports alone
linux port=/dev/ttyUSB0 | lasting name | warning | use {LINKED}
linux port=/dev/ttyUSB0 | lasting name | warning | the same serial number (A50285BI)
twins | lasting name | warning | other adapters out
twins | reset on open | ok | CH340
linux latency_ms=16 | FTDI latency | warning | 16 ms
linux on_battery=yes | computer sleep | warning | systemd-inhibit
mac port=/dev/tty.usbserial-A50285BI | port | problem | use /dev/cu.usbserial-A50285BI
mac | other users | not checked | Darwin does not report
mac | FTDI latency | not checked | follows the baud rate
mac | port grabbers | not checked | no program is known
mac | udev rule | -
mac | computer sleep | not checked | caffeinate
windows | permission | not checked | every user
windows | other users | not checked | Windows does not report
windows | FTDI latency | not checked | Device Manager
windows | port grabbers | not checked | no program is known
windows | udev rule | -
windows port=com12 | port | ok | is there
windows port=\\\\.\\COM12 | port | ok | is there
"""
"""What surrounds a port, and of one cause the verdict and some words; `-` where there is none."""


def value_of(key, text):
    if key == "holders":
        name, _, pid = text.partition(":")
        return (Holder(int(pid), name),)
    if key in ("groups", "groups_on_file", "programs"):
        return frozenset(filter(None, text.split(",")))
    return {"yes": True, "no": False}.get(text, int(text) if text.isdigit() else text)


@pytest.mark.parametrize("row", FOUND.strip().split("\n"))
def test_what_is_found(row):
    around, name, verdict, *words = row.split(" | ")
    base, *pairs = around.split(" ")
    changes = {key: value_of(key, text) for key, _, text in (pair.partition("=") for pair in pairs)}
    hits = [item for item in findings(replace(BASES[base], **changes)) if item.name == name]
    assert [item.verdict for item in hits] == ([] if verdict == "-" else [verdict])
    assert not words or words[0] in f"{hits[0].sentence} {hits[0].fix}"


def test_the_shipped_rule_names_what_it_mends():
    text = udev_rule()
    for word in ("uaccess", "ID_MM_DEVICE_IGNORE", 'latency_timer}="1"', "0403", "1a86"):
        assert word in text
    for line in text.splitlines():
        assert line.startswith(("#", "ACTION", "SUBSYSTEM", "LABEL"))


def test_looking_around_this_computer_gives_something_to_judge():
    assert findings(probe_environment())


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
    (other,) = network_findings(f"mavlink:udpout:127.0.0.1:{port}")
    assert other.verdict == "not checked"
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
