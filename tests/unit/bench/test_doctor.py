"""Findings of the doctor, judged from surroundings that were made up for each platform."""

import socket
from dataclasses import replace

import pytest

from benchtool.bench.doctor.causes import (
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


@pytest.fixture(autouse=True)
def by_id_leads_to_the_port(monkeypatch):
    real = {FTDI.by_id: FTDI.name}
    monkeypatch.setattr(
        "benchtool.bench.doctor.ports.os.path.realpath",
        lambda path: real.get(path, path),
    )


def found(around, name):
    hits = [finding for finding in findings(around) if finding.name == name]
    assert len(hits) <= 1
    return hits[0] if hits else None


def test_a_healthy_port_on_linux_has_nothing_to_mend():
    verdicts = {finding.name: finding.verdict for finding in findings(LINUX)}
    assert verdicts == {
        "port": "ok",
        "permission": "ok",
        "other users": "ok",
        "port grabbers": "ok",
        "udev rule": "ok",
        "lasting name": "ok",
        "FTDI latency": "ok",
        "reset on open": "ok",
        "computer sleep": "not checked",
    }


@pytest.mark.parametrize("healthy", [LINUX, MAC, WINDOWS])
def test_whatever_is_not_ok_says_what_to_do_or_why_it_was_not_tried(healthy):
    for finding in findings(healthy):
        assert finding.sentence
        if finding.verdict in ("warning", "problem"):
            assert finding.fix


def test_a_missing_group_names_the_command():
    around = replace(
        LINUX, may_open=False, groups=frozenset(), groups_on_file=frozenset(), rule_installed=False
    )
    finding = found(around, "permission")
    assert finding.verdict == "problem"
    assert "sudo usermod -aG dialout ada" in finding.fix
    assert INSTALL_RULE in finding.fix


def test_a_group_of_which_this_session_knows_nothing_needs_a_new_login():
    finding = found(replace(LINUX, may_open=False, groups=frozenset({"ada"})), "permission")
    assert finding.verdict == "problem"
    assert finding.fix == "log out and in again"


def test_a_port_that_is_not_there_lists_those_that_are():
    finding = found(replace(LINUX, port="/dev/ttyUSB7", exists=False), "port")
    assert finding.verdict == "problem"
    assert "present: /dev/ttyUSB0" in finding.sentence


def test_no_port_at_all_offers_the_virtual_bench():
    finding = found(HostEnvironment(system="Linux"), "port")
    assert finding.verdict == "problem"
    assert "bench serve" in finding.fix


def test_the_program_that_holds_the_port_is_named():
    finding = found(replace(LINUX, holders=(Holder(812, "minicom"),)), "other users")
    assert finding.verdict == "problem"
    assert "minicom (pid 812)" in finding.sentence


def test_the_server_behind_a_pseudo_terminal_is_no_rival():
    around = HostEnvironment(
        system="Linux",
        port="/dev/pts/3",
        exists=True,
        may_open=True,
        is_terminal=True,
        holders=(Holder(99, "python", is_terminal=True),),
        programs=frozenset({"modemmanager"}),
        rule_installed=False,
    )
    assert found(around, "other users").verdict == "ok"
    assert found(around, "port grabbers") is None
    assert found(around, "udev rule") is None


@pytest.mark.parametrize(
    ("programs", "rule", "verdict", "said"),
    [
        ({"modemmanager"}, False, "warning", "install the udev rule"),
        ({"modemmanager"}, True, "ok", ""),
        ({"brltty"}, True, "warning", "remove brltty"),
        ({"brltty", "modemmanager"}, False, "warning", "ModemManager leave bench ports alone; "),
    ],
)
def test_programs_that_grab_ports_are_named(programs, rule, verdict, said):
    around = replace(LINUX, programs=frozenset(programs), rule_installed=rule)
    finding = found(around, "port grabbers")
    assert finding.verdict == verdict
    assert said in finding.fix


def test_a_number_that_may_change_is_traded_for_the_lasting_name():
    finding = found(replace(LINUX, port="/dev/ttyUSB0"), "lasting name")
    assert finding.verdict == "warning"
    assert f"serial:{FTDI.by_id}" in finding.fix
    assert "A50285BI" in finding.fix


def test_an_adapter_without_serial_number_cannot_be_told_from_its_twin():
    ch340 = Port(name="/dev/ttyUSB0", vendor=0x1A86, product=0x7523)
    twin = replace(ch340, name="/dev/ttyUSB1")
    around = replace(LINUX, port="/dev/ttyUSB0", ports=(ch340, twin), latency_ms=None)
    finding = found(around, "lasting name")
    assert finding.verdict == "warning"
    assert "other adapters out" in finding.fix
    assert "CH340" in found(around, "reset on open").sentence


def test_slow_ftdi_adapters_are_noticed():
    finding = found(replace(LINUX, latency_ms=16), "FTDI latency")
    assert finding.verdict == "warning"
    assert "16 ms" in finding.sentence


def test_macos_tty_names_wait_for_a_carrier():
    finding = found(replace(MAC, port="/dev/tty.usbserial-A50285BI"), "port")
    assert finding.verdict == "problem"
    assert finding.fix == "use /dev/cu.usbserial-A50285BI"


def test_what_a_platform_does_not_tell_is_said():
    for around in (MAC, WINDOWS):
        assert found(around, "other users").verdict == "not checked"
        assert found(around, "FTDI latency").verdict == "not checked"
        assert found(around, "port grabbers").verdict == "not checked"
        assert found(around, "udev rule") is None
    assert found(WINDOWS, "permission").verdict == "not checked"
    assert "Device Manager" in found(WINDOWS, "FTDI latency").fix
    assert "caffeinate" in found(MAC, "computer sleep").fix


@pytest.mark.parametrize("port", ["COM12", "com12", r"\\.\COM12"])
def test_windows_ports_are_found_under_all_their_names(port):
    assert found(replace(WINDOWS, port=port), "port").verdict == "ok"


def test_a_computer_on_its_battery_may_fall_asleep():
    finding = found(replace(LINUX, on_battery=True), "computer sleep")
    assert finding.verdict == "warning"
    assert "systemd-inhibit" in finding.fix


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
