"""`benchtool ports`: the serial ports of this computer."""

from __future__ import annotations

from typing import Annotated

import typer


def command(
    probe: Annotated[
        bool, typer.Option("--probe", help="Open every port and ask who is there; resets boards.")
    ] = False,
    baud: Annotated[int, typer.Option(help="Bits per second for --probe.")] = 2_000_000,
) -> None:
    """List serial ports and, with --probe, what answers on them."""
    from benchtool.bench.doctor.ports import ask_port, serial_ports
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
        if probe:
            answer = ask_port(SerialPort(port.name, baud), port.name)
            print(f"    {answer.kind}: {answer.text}")
    if found and not probe:
        print("--probe asks each who is there; opening a port resets many boards")
