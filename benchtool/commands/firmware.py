"""`benchtool firmware` and `bench bridge`: programs that make other hardware a bench."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from annotated_types import Ge, Le

from benchtool.commands.declared import declared
from benchtool.commands.terminal.messages import write_new
from benchtool.core.errors import InputError
from benchtool.core.inputs import Input, Inputs


@dataclass(frozen=True, slots=True, kw_only=True)
class FirmwareInputs(Inputs):
    """What `benchtool firmware` takes."""

    out: Annotated[Path, Input("Folder to make; the Arduino sketch is named after it.")]
    board: Annotated[str, Input("What it shall run on: uno, nano.")] = "uno"
    rig: Annotated[str, Input("Rig or rig file whose motors, pulses and limits it takes.")] = (
        "pquad_single"
    )
    device_id: Annotated[str, Input("The device's own name.", empty="a new one")] = ""


@declared(FirmwareInputs)
def firmware(inputs: FirmwareInputs) -> None:
    """Write the firmware that makes an Arduino a rotor bench."""
    from secrets import token_hex

    from benchtool.bench.serial.sketch_files import board_named, sketch_files
    from benchtool.core.rig_file import rig_named

    out = inputs.out
    known = board_named(inputs.board)
    name = inputs.device_id or f"{inputs.board}-{token_hex(3)}"
    folder = out.resolve()
    files = sketch_files(known, rig_named(inputs.rig), name, folder.name)

    def write() -> None:
        folder.mkdir(parents=True)
        for file, text in files.items():
            (folder / file).write_text(text, encoding="utf-8", newline="\n")

    write_new(out, write, "another folder with --out")
    print(f"written: {out}, {len(files)} files for {known.title}, device {name}")
    print("look through settings.h (limits, sensors) and pins.h (wiring), then one of:")
    print(f"  make -C {out} upload PORT=/dev/ttyACM0   (needs avr-gcc, avr-libc, avrdude)")
    print(f"  open {out / folder.name}.ino in the Arduino IDE and press Upload")
    print("and, with the propeller off: benchtool ports --probe --baud 500000")


@dataclass(frozen=True, slots=True, kw_only=True)
class BridgeInputs(Inputs):
    """What `benchtool bench bridge` takes."""

    out: Annotated[Path, Input("Script to write; ends in .js.")]
    rig: Annotated[str, Input("Rig or rig file whose pulses and limits it takes.")] = "pquad_single"
    speed: Annotated[str, Input("Reading that gives rotor speed: optical, electrical.")] = "optical"
    port: Annotated[int, Ge(1), Le(65535), Input("UDP port on which the script listens.")] = 55047
    host: Annotated[str, Input("IPv4 address of this computer, as the GUI's computer sees it.")] = (
        "127.0.0.1"
    )
    host_port: Annotated[int, Ge(1), Le(65535), Input("UDP port on which benchtool listens.")] = (
        64126
    )


@declared(BridgeInputs)
def bridge(inputs: BridgeInputs) -> None:
    """Write the script that makes the RCbenchmark GUI a bench with a watchdog."""
    from benchtool.bench.rcbenchmark.lines import (
        HOST_PORT,
        LOOPBACK,
        RAMP_MS,
        SILENCE_MS,
        bridge_text,
    )
    from benchtool.core.rig_file import rig_named

    out, host, host_port = inputs.out, inputs.host, inputs.host_port
    rig = rig_named(inputs.rig)
    text = bridge_text(rig, inputs.speed, listen_port=inputs.port, host=host, host_port=host_port)
    if out.suffix != ".js":
        raise InputError(f"--out {out} is no name of a script; end it in .js")
    write_new(out, lambda: out.write_text(text, encoding="utf-8", newline="\n"))
    gui = LOOPBACK if host == LOOPBACK else "GUI_COMPUTER"
    listen = "" if host_port == HOST_PORT else f"?listen={host_port}"
    print(f"written: {out}; look through its first lines, then run it in the GUI")
    print(f"and, with the propeller off: benchtool bench check rcbudp:{gui}:{inputs.port}{listen}")
    print(
        f"it brings the motor down {SILENCE_MS} ms after the last word, within {RAMP_MS} ms; a GUI "
        f"that crashes or sleeps, or a pulled USB cable, it cannot guard against: keep a switch at "
        f"hand"
    )
