"""Command `benchtool firmware`: Arduino sketch of a rotor bench."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from benchtool.commands.input_commands import command_from_inputs
from benchtool.commands.terminal.messages import write_new
from benchtool.core.inputs import Input, Inputs


@dataclass(frozen=True, slots=True, kw_only=True)
class FirmwareInputs(Inputs):
    """Options of `benchtool firmware`."""

    out: Annotated[Path, Input("New folder; also the name of the Arduino sketch.")]
    board: Annotated[str, Input("Board: uno, nano.")] = "uno"
    rig: Annotated[str, Input("Rig name or file for motors, pulse widths and limits.")] = (
        "pquad_single"
    )
    device_id: Annotated[str, Input("Device id.", default_text="random")] = ""


@command_from_inputs(FirmwareInputs)
def firmware(inputs: FirmwareInputs) -> None:
    """Generate bench firmware for an Arduino."""
    from secrets import token_hex

    from benchtool.bench.serial.sketch import BOARDS, sketch_files
    from benchtool.core.rig_file import load_rig_by_name

    out = inputs.out
    name = inputs.device_id or f"{inputs.board}-{token_hex(3)}"
    folder = out.resolve()
    files = sketch_files(inputs.board, load_rig_by_name(inputs.rig), name, folder.name)

    def write() -> None:
        folder.mkdir(parents=True)
        for file, text in files.items():
            (folder / file).write_text(text, encoding="utf-8", newline="\n")

    write_new(out, write, "another folder with --out")
    print(f"written: {out}, {len(files)} files for {BOARDS[inputs.board]}, device {name}")
    print("check settings.h (limits, sensors) and pins.h (wiring), then one of:")
    print(f"  make -C {out} upload PORT=/dev/ttyACM0   (needs avr-gcc, avr-libc, avrdude)")
    print(f"  open {out / folder.name}.ino in the Arduino IDE and press Upload")
    print("then, without propeller: benchtool ports --probe --baud 500000")
