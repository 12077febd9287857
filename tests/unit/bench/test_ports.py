"""Serial ports: list, answer to a hello, and findings for made-up surroundings."""

import socket
from dataclasses import replace

import pytest

from benchtool.bench.ports import (
    HostEnvironment,
    Port,
    diagnose_address,
    diagnose_port,
)
from benchtool.bench.transport.transport import PortOwner
from benchtool.core.errors import InputError

FTDI = Port(name="/dev/ttyUSB0", vendor=0x0403, product=0x6001)
LINUX = HostEnvironment(
    system="Linux",
    port=FTDI.name,
    ports=(FTDI,),
    exists=True,
    can_open=True,
    group="dialout",
    user="ada",
    groups=frozenset({"ada", "dialout"}),
    groups_on_file=frozenset({"dialout"}),
    owners=(),
)
MAC = replace(
    LINUX,
    system="Darwin",
    port="/dev/cu.usbserial-1",
    ports=(replace(FTDI, name="/dev/cu.usbserial-1"),),
    owners=None,
)
WINDOWS = HostEnvironment(system="Windows", port="COM12", ports=(replace(FTDI, name="COM12"),))
BASES = {
    "linux": LINUX,
    "mac": MAC,
    "windows": WINDOWS,
    "bare": HostEnvironment(system="Linux"),
    "terminal": replace(LINUX, owners=(PortOwner(99, "python", is_terminal=True),)),
}
FOUND = """
linux | port | ok | is present
linux | permission | ok | ada may open
linux | other users | ok | no program
linux can_open=no groups= groups_on_file= | permission | problem | -aG dialout ada
linux can_open=no groups=ada | permission | problem | log out and in again
linux port=/dev/ttyUSB7 exists=no | port | problem | present: /dev/ttyUSB0
bare | port | problem | `benchtool bench serve` makes a virtual bench
linux owners=minicom:812 | other users | problem | minicom (pid 812)
terminal | other users | ok | python (pid 99)
mac port=/dev/tty.usbserial-1 | port | problem | use /dev/cu.usbserial-1
mac | other users | not checked | Darwin does not report
windows | permission | not checked | every user
windows | other users | not checked | Windows does not report
windows port=com12 | port | ok | is present
windows port=\\\\.\\COM12 | port | ok | is present
"""
"""Facts about a port, and of one cause the verdict and some words."""


def value_of(key, text):
    if key == "owners":
        name, _, pid = text.partition(":")
        return (PortOwner(int(pid), name),)
    if key in ("groups", "groups_on_file"):
        return frozenset(filter(None, text.split(",")))
    return {"yes": True, "no": False}.get(text, text)


@pytest.mark.parametrize("row", FOUND.strip().split("\n"))
def test_what_is_found(row):
    around, name, verdict, words = row.split(" | ")
    base, *pairs = around.split(" ")
    changes = {key: value_of(key, text) for key, _, text in (pair.partition("=") for pair in pairs)}
    (hit,) = (item for item in diagnose_port(replace(BASES[base], **changes)) if item.name == name)
    assert hit.verdict == verdict
    assert words in f"{hit.sentence} {hit.fix}"


def test_an_address_without_a_port_is_refused():
    with pytest.raises(InputError, match="has no port to check"):
        diagnose_address("sim:pquad")


def test_a_udp_port_in_use_is_a_problem():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own:
        own.bind(("127.0.0.1", 0))
        port = own.getsockname()[1]
        (finding,) = diagnose_address(f"mavlink:udpin:127.0.0.1:{port}")
        assert finding.verdict == "problem"
        assert f"another program listens on UDP 127.0.0.1:{port}" in finding.sentence
    (other,) = diagnose_address(f"mavlink:udpout:127.0.0.1:{port}")
    assert other.verdict == "not checked"
    (finding,) = diagnose_address(f"mavlink:udpin:127.0.0.1:{port}")
    assert (finding.verdict, finding.sentence) == ("ok", f"UDP 127.0.0.1:{port} is free")
