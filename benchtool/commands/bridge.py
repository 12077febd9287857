"""`benchtool bench bridge`: the script that makes the RCbenchmark GUI a bench."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from annotated_types import Ge, Le

from benchtool.commands.declared import declared
from benchtool.core.inputs import Input, Inputs


@dataclass(frozen=True, slots=True, kw_only=True)
class BridgeInputs(Inputs):
    """What `benchtool bench bridge` takes."""

    out: Annotated[Path, Input("Script to write; ends in .js.")]
    rig: Annotated[str, Input("Rig or rig file whose pulses and limits it takes.")] = "pquad_single"
    speed: Annotated[str, Input("Reading that tells rotor speed: optical, electrical.")] = "optical"
    port: Annotated[int, Ge(1), Le(65535), Input("UDP port on which the script listens.")] = 55047
    host: Annotated[str, Input("IPv4 address of this computer, as the GUI's computer sees it.")] = (
        "127.0.0.1"
    )
    host_port: Annotated[int, Ge(1), Le(65535), Input("UDP port on which benchtool listens.")] = (
        64126
    )


def bridge(inputs: BridgeInputs) -> None:
    """Write the script that makes the RCbenchmark GUI a bench with a watchdog."""
    from benchtool.bench.rcbenchmark.lines import (
        HOST_PORT,
        LOOPBACK,
        RAMP_MS,
        SILENCE_MS,
        bridge_text,
    )
    from benchtool.core.errors import InputError, WouldOverwrite
    from benchtool.core.rig_file import rig_named

    out, host, host_port = inputs.out, inputs.host, inputs.host_port
    rig = rig_named(inputs.rig)
    text = bridge_text(rig, inputs.speed, listen_port=inputs.port, host=host, host_port=host_port)
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
    print(f"and, with the propeller off: benchtool bench check rcbudp:{gui}:{inputs.port}{listen}")
    print(
        f"it brings the motor down {SILENCE_MS} ms after the last word, within {RAMP_MS} ms; a GUI "
        f"that crashes or sleeps, or a pulled USB cable, it cannot guard against: keep a switch at "
        f"hand"
    )


command = declared(BridgeInputs, bridge)
