"""The folder as the Arduino IDE takes it: the sketch, the core, and its own way to link them."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from benchtool.bench.serial.sketch import CLOCK_HZ, MCU
from tests.avr.avr_bench import AvrBench
from tests.avr.conftest import RIG

AVR = Path("/usr/share/arduino/hardware/arduino/avr")
CORE, VARIANT = AVR / "cores" / "arduino", AVR / "variants" / "standard"

# Of the core's platform.txt; warnings are silenced there as well.
BOTH = ["-c", "-g", "-Os", "-w", "-ffunction-sections", "-fdata-sections", "-flto"]
BOTH += [f"-mmcu={MCU}", f"-DF_CPU={CLOCK_HZ}L", "-DARDUINO=10819"]
BOTH += ["-DARDUINO_AVR_UNO", "-DARDUINO_ARCH_AVR", f"-I{CORE}", f"-I{VARIANT}"]
# Debian's avr-gcc 5.4 defines it for C only; the IDE brings 7.3.
BOTH += ["-DDECIMAL_DIG=__DECIMAL_DIG__"]
CPP = ["avr-g++", "-std=gnu++11", "-fpermissive", "-fno-exceptions", "-fno-threadsafe-statics"]
C = ["avr-gcc", "-std=gnu11", "-fno-fat-lto-objects"]


def compiled(source: Path, folder: Path, *more: str) -> Path:
    """Compile one file as the IDE does."""
    target = folder / f"{source.name}.o"
    assembler = ["-x", "assembler-with-cpp"] if source.suffix == ".S" else []
    words = C if source.suffix in (".c", ".S") else CPP
    subprocess.run([*words, *BOTH, *assembler, *more, source, "-o", target], check=True)
    return target


@pytest.mark.skipif(not CORE.exists(), reason="needs apt-get install arduino-core-avr")
def test_the_sketch_links_with_the_arduino_core_and_runs(peer, firmware, tmp_path):
    sketch = firmware.parent
    core = [
        compiled(source, tmp_path)
        for source in sorted(CORE.iterdir())
        if source.suffix in (".c", ".cpp", ".S")
    ]
    archive = tmp_path / "core.a"
    subprocess.run(["avr-gcc-ar", "rcs", archive, *core], check=True)
    own = [compiled(source, tmp_path) for source in sorted(sketch.glob("*.c"))]
    (ino,) = sketch.glob("*.ino")
    own.append(compiled(ino, tmp_path, "-x", "c++", "-include", "Arduino.h"))
    program = tmp_path / "sketch.elf"
    flags = ["-w", "-Os", "-g", "-flto", "-fuse-linker-plugin", "-Wl,--gc-sections"]
    subprocess.run(
        ["avr-gcc", *flags, f"-mmcu={MCU}", "-o", program, *own, archive, "-lm"], check=True
    )
    with AvrBench(peer, program, RIG) as bench:
        state = bench.wait(lambda state: state.edge_us > 50e3)
        assert state.pulses_us[0] == pytest.approx(1000.0, abs=0.5)
