"""`benchtool ports`: the serial ports of this computer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Le

from benchtool.commands.declared import declared
from benchtool.core.inputs import Input, Inputs


@dataclass(frozen=True, slots=True, kw_only=True)
class PortsInputs(Inputs):
    """What `benchtool ports` takes."""

    probe: Annotated[bool, Input("Open every port and ask who is there; resets boards.")] = False
    baud: Annotated[int, Ge(1), Le(100_000_000), Input("Bits per second for --probe.")] = 2_000_000


def ports(inputs: PortsInputs) -> None:
    """List serial ports and, with --probe, what answers on them."""
    from benchtool.bench.doctor.ports import identify_port, serial_ports
    from benchtool.bench.transport.serial_port import SerialPort

    found = serial_ports()
    if not found:
        print("no serial ports; plug a bench in, or try: benchtool bench serve")
    for port in found:
        number = f"serial number {port.serial_number}" if port.serial_number else ""
        words = [word for word in (port.description, port.usb, number) if word]
        print(f"serial:{port.name}  {', '.join(words)}")
        if port.by_id:
            print(f"    lasting name: serial:{port.by_id}")
        if inputs.probe:
            answer = identify_port(SerialPort(port.name, inputs.baud), port.name)
            print(f"    {answer.kind}: {answer.text}")
    if found and not inputs.probe:
        print("--probe asks each who is there; opening a port resets many boards")


command = declared(PortsInputs, ports)
