"""Command `benchtool ports`: list of serial ports, or diagnosis of one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import typer
from annotated_types import Ge, Le

from benchtool.commands.input_commands import command_from_inputs
from benchtool.core.errors import InputError
from benchtool.core.inputs import Input, Inputs

DEFAULT_BAUD = 2_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class PortsInputs(Inputs):
    """Options of `benchtool ports`."""

    port: Annotated[
        str, Input("Port to diagnose: /dev/ttyUSB0, COM12, or a bench address.", argument="PORT")
    ] = ""
    probe: Annotated[bool, Input("Open each port and identify the device; resets boards.")] = False
    baud: Annotated[int, Ge(1), Le(100_000_000), Input("Baud rate for --probe.")] = DEFAULT_BAUD


@command_from_inputs(PortsInputs)
def ports(inputs: PortsInputs) -> None:
    """List serial ports and diagnose connection problems.

    Without PORT, all serial ports are listed. With PORT, the exit code is 3 if there is a problem.
    """
    if inputs.port and (inputs.probe or inputs.baud != DEFAULT_BAUD):
        raise InputError("--probe and --baud are for the list of all ports; remove them or PORT")
    if inputs.port:
        _diagnose_port(inputs.port)
        return
    from benchtool.bench.ports import identify_port, serial_ports
    from benchtool.bench.transport.ports import SerialPort

    found_ports = serial_ports()
    if not found_ports:
        print("no serial ports; connect a bench, or try: benchtool bench serve")
    for port in found_ports:
        serial_number = f"serial number {port.serial_number}" if port.serial_number else ""
        details = [text for text in (port.description, port.usb, serial_number) if text]
        print(f"serial:{port.name}  {', '.join(details)}")
        if port.by_id:
            print(f"    persistent name: serial:{port.by_id}")
        if inputs.probe:
            answer = identify_port(SerialPort(port.name, inputs.baud), port.name)
            print(f"    {answer.kind}: {answer.text}")
    if found_ports and not inputs.probe:
        print("--probe identifies the devices; opening a port resets many boards")


def _diagnose_port(address: str) -> None:
    from benchtool.bench.ports import diagnose_address

    diagnosis = diagnose_address(address)
    for finding in diagnosis:
        print(f"{finding.verdict:11}  {finding.name}: {finding.sentence}")
        if finding.fix:
            print(f"{'':11}  -> {finding.fix}")
    if any(finding.verdict == "problem" for finding in diagnosis):
        raise typer.Exit(3)
