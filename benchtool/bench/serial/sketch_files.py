"""The bench firmware as files: the C sources in `sketch/` with a rig's numbers filled in."""

from __future__ import annotations

import re
from importlib import resources

from benchtool import __version__
from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.rig import Rig

BOARDS = {"uno": "Arduino Uno R3", "nano": "Arduino Nano, bootloader of 2018 or later"}
MCU, CLOCK_HZ, UPLOAD_BAUD = "atmega328p", 16_000_000, 115_200  # as in the core's boards.txt

MAX_MOTORS = 2  # outputs of the one 16-bit timer (ATmega328P, chapter 16: OC1A, OC1B)
SHORTEST_US, LONGEST_US = 500.0, 2500.0  # plausible pulses of ESCs and servos; assumed

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,31}")


def sketch_files(board: str, rig: Rig, device_id: str, folder: str) -> dict[str, str]:
    """Return the text of every file of the firmware by its name.

    Args:
        folder: name of the folder that will hold them; an Arduino sketch is named after it.
    """
    if board not in BOARDS:
        raise UnknownChoice("board", board, BOARDS)
    for what, name in (("device name", device_id), ("folder name for a sketch", folder)):
        if not _NAME.fullmatch(name):
            raise InputError(
                f"{name!r} cannot be a {what}; take 1 to 32 letters, digits, - and _, a letter or "
                f"digit first"
            )
    numbers = {**_rig_numbers(board, rig), "DEVICE": device_id}
    numbers |= {"MCU": MCU, "F_CPU": str(CLOCK_HZ)}
    numbers |= {"UPLOAD_BAUD": str(UPLOAD_BAUD), "VERSION": __version__}
    files = {}
    for item in (resources.files("benchtool") / "library" / "sketch").iterdir():
        name = f"{folder}.ino" if item.name == "sketch.ino" else item.name
        text = item.read_text(encoding="utf-8")
        files[name] = re.sub(r"@([A-Z_]+)@", lambda found: numbers[found[1]], text)
    return dict(sorted(files.items()))


def _rig_numbers(board: str, rig: Rig) -> dict[str, str]:
    pulse, limits = rig.propulsion, rig.limits
    if rig.n_rotors > MAX_MOTORS:
        raise InputError(
            f"rig {rig.name} has {rig.n_rotors} motors, and the timer of board {board} makes "
            f"pulses for {MAX_MOTORS}; take a rig with 1 or {MAX_MOTORS} rotors"
        )
    for name, pulse_us in (
        ("propulsion.pwm_stop_us", pulse.pwm_stop_us),
        ("limits.pwm_us", limits.pwm_us),
    ):
        if not SHORTEST_US <= pulse_us <= LONGEST_US:
            raise InputError(
                f"{name} of rig {rig.name} is {pulse_us:g} us, and ESC pulses lie from "
                f"{SHORTEST_US:g} to {LONGEST_US:g} us; correct the rig"
            )
    return {
        "BOARD": board,
        "RIG": rig.name,
        "MOTORS": str(rig.n_rotors),
        "PWM_STOP": f"{pulse.pwm_stop_us:g}",
        "PWM_IDLE": f"{max(pulse.pwm_stop_us, pulse.pwm_start_us):g}",
        "LIMIT_PWM": f"{limits.pwm_us:g}",
        "LIMIT_THRUST": f"{min(limits.thrust_N, limits.load_cell_rating_N):g}",
        "LIMIT_RPM": f"{limits.rpm:g}",
        "LIMIT_VOLTAGE": f"{limits.voltage_min_V:g}",
    }
