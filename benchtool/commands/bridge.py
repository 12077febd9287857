"""`benchtool bench bridge`: the script that makes the RCbenchmark GUI a bench."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def bridge(
    out: Annotated[Path, typer.Option(help="Script to write; ends in .js.")],
    rig: Annotated[
        str, typer.Option(help="Rig or rig file whose pulses and limits it takes.")
    ] = "pquad_single",
    speed: Annotated[
        str, typer.Option(help="Reading that tells rotor speed: optical, electrical.")
    ] = "optical",
    port: Annotated[int, typer.Option(help="UDP port on which the script listens.")] = 55047,
    host: Annotated[
        str, typer.Option(help="IPv4 address of this computer, as the GUI's computer sees it.")
    ] = "127.0.0.1",
    host_port: Annotated[int, typer.Option(help="UDP port on which benchtool listens.")] = 64126,
) -> None:
    """Write the script that makes the RCbenchmark GUI a bench with a watchdog."""
    from benchtool.bench.rcbenchmark.bridge_file import (
        HOST_PORT,
        LOOPBACK,
        RAMP_MS,
        SILENCE_MS,
        BridgePlace,
        bridge_text,
    )
    from benchtool.core.errors import InputError, WouldOverwrite
    from benchtool.core.rig_file import rig_named

    place = BridgePlace(listen_port=port, host=host, host_port=host_port)
    text = bridge_text(rig_named(rig), place, speed)
    if out.suffix != ".js":
        raise InputError(f"--out {out} is no name of a script; end it in .js")
    if out.exists() or out.is_symlink():
        raise WouldOverwrite(str(out))
    try:
        out.write_text(text, encoding="utf-8", newline="\n")
    except OSError as error:
        raise InputError(
            f"{out} cannot be written ({error.strerror}); choose another --out"
        ) from error
    gui = LOOPBACK if host == LOOPBACK else "GUI_COMPUTER"
    listen = "" if host_port == HOST_PORT else f"?listen={host_port}"
    print(f"written: {out}; look through its first lines, then run it in the GUI")
    print(f"and, with the propeller off: benchtool bench check rcbudp:{gui}:{port}{listen}")
    print(
        f"it brings the motor down {SILENCE_MS} ms after the last word, within {RAMP_MS} ms; a GUI "
        f"that crashes or sleeps, or a pulled USB cable, it cannot guard against: keep a switch at "
        f"hand"
    )
