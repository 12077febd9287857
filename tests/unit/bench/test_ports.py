"""Listing ports, and asking who is there."""

from types import SimpleNamespace

from benchtool.bench.doctor.ports import identify_port, serial_ports
from benchtool.core.rig_file import rig_named
from benchtool.physics.model_file import load_model
from benchtool.testing.loopback_link import LoopbackLink
from benchtool.virtual.devices import hello_of, virtual_plant
from benchtool.virtual.firmware import Firmware


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
