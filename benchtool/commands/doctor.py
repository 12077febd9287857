"""`benchtool doctor`: what keeps a port from working."""

from __future__ import annotations

from typing import Annotated

import typer


def command(
    port: Annotated[
        str, typer.Argument(help="What to look at: /dev/ttyUSB0, COM12, or a bench's address.")
    ] = "",
    udev_rule: Annotated[
        bool, typer.Option("--udev-rule", help="Print the udev rule for Linux and exit.")
    ] = False,
) -> None:
    """Explain what keeps a serial port from working."""
    from benchtool.bench.doctor import causes as doctor
    from benchtool.bench.doctor.host_environment import probe_environment
    from benchtool.bench.doctor.network import network_findings, serial_port_of

    if udev_rule:
        print(doctor.udev_rule(), end="")
        return
    place = serial_port_of(port)
    found = network_findings(port) if place is None else doctor.findings(probe_environment(place))
    for finding in found:
        print(f"{finding.verdict:11}  {finding.name}: {finding.sentence}")
        if finding.fix:
            print(f"{'':11}  -> {finding.fix}")
    if any(finding.verdict == "problem" for finding in found):
        raise typer.Exit(3)
