"""`benchtool doctor`: what keeps a port from working."""

from __future__ import annotations

from typing import Annotated

import typer


def command(
    port: Annotated[
        str, typer.Argument(help="Port to look at, as /dev/ttyUSB0, COM12 or its address.")
    ] = "",
    udev_rule: Annotated[
        bool, typer.Option("--udev-rule", help="Print the udev rule for Linux and exit.")
    ] = False,
) -> None:
    """Explain what keeps a serial port from working."""
    from benchtool.bench import doctor
    from benchtool.bench.surroundings import look_around

    if udev_rule:
        print(doctor.udev_rule(), end="")
        return
    place = port.removeprefix("serial:").partition("?")[0]
    found = doctor.findings(look_around(place))
    for finding in found:
        print(f"{finding.verdict:11}  {finding.name}: {finding.sentence}")
        if finding.fix:
            print(f"{'':11}  -> {finding.fix}")
    if any(finding.verdict == "problem" for finding in found):
        raise typer.Exit(3)
