"""`benchtool ports` and `doctor`: serial ports, and what keeps one from working."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import typer
from annotated_types import Ge, Le

from benchtool.commands.input_commands import command_from_inputs
from benchtool.core.inputs import Input, Inputs


@dataclass(frozen=True, slots=True, kw_only=True)
class PortsInputs(Inputs):
    """What `benchtool ports` takes."""

    probe: Annotated[bool, Input("Open every port and ask who is there; resets boards.")] = False
    baud: Annotated[int, Ge(1), Le(100_000_000), Input("Bits per second for --probe.")] = 2_000_000


@command_from_inputs(PortsInputs)
def ports(inputs: PortsInputs) -> None:
    """List serial ports and, with --probe, what answers on them."""
    from benchtool.bench.ports import identify_port, serial_ports
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


@dataclass(frozen=True, slots=True, kw_only=True)
class DoctorInputs(Inputs):
    """What `benchtool doctor` takes."""

    port: Annotated[
        str, Input("What to look at: /dev/ttyUSB0, COM12, or a bench's address.", argument="PORT")
    ] = ""


@command_from_inputs(DoctorInputs)
def doctor(inputs: DoctorInputs) -> None:
    """Explain what keeps a serial port from working."""
    from benchtool.bench import ports

    place = ports.parse_serial_port(inputs.port)
    found = (
        ports.network_findings(inputs.port)
        if place is None
        else ports.findings(ports.probe_environment(place))
    )
    for finding in found:
        print(f"{finding.verdict:11}  {finding.name}: {finding.sentence}")
        if finding.fix:
            print(f"{'':11}  -> {finding.fix}")
    if any(finding.verdict == "problem" for finding in found):
        raise typer.Exit(3)
