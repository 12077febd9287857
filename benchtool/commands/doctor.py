"""`benchtool doctor`: what keeps a port from working."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import typer

from benchtool.commands.declared import declared
from benchtool.core.inputs import Input, Inputs


@dataclass(frozen=True, slots=True, kw_only=True)
class DoctorInputs(Inputs):
    """What `benchtool doctor` takes."""

    port: Annotated[
        str,
        Input("What to look at: /dev/ttyUSB0, COM12, or a bench's address.", argument="PORT"),
    ] = ""
    udev_rule: Annotated[bool, Input("Print the udev rule for Linux and exit.")] = False


def run(inputs: DoctorInputs) -> None:
    """Explain what keeps a serial port from working."""
    from benchtool.bench.doctor import causes as doctor
    from benchtool.bench.doctor.causes import network_findings, serial_port_of
    from benchtool.bench.doctor.ports import probe_environment

    if inputs.udev_rule:
        print(doctor.udev_rule(), end="")
        return
    place = serial_port_of(inputs.port)
    found = (
        network_findings(inputs.port)
        if place is None
        else doctor.findings(probe_environment(place))
    )
    for finding in found:
        print(f"{finding.verdict:11}  {finding.name}: {finding.sentence}")
        if finding.fix:
            print(f"{'':11}  -> {finding.fix}")
    if any(finding.verdict == "problem" for finding in found):
        raise typer.Exit(3)


command = declared(DoctorInputs, run)
