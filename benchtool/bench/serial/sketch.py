"""Firmware of a rotor bench for an Arduino, from a rig."""

from __future__ import annotations

import re
from importlib import resources

from benchtool import __version__
from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.rig import Rig

BOARDS = {"uno": "Arduino Uno R3", "nano": "Arduino Nano, bootloader of 2018 or later"}
MCU, CLOCK_HZ, UPLOAD_BAUD = "atmega328p", 16_000_000, 115_200  # as in the core's boards.txt

MAX_MOTORS = 2  # outputs of the one 16-bit timer (ATmega328P, chapter 16: OC1A, OC1B)
MIN_PULSE_US, MAX_PULSE_US = 500.0, 2500.0  # plausible pulse widths of ESCs and servos; assumed

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,31}")


def sketch_files(board: str, rig: Rig, device_id: str, folder: str) -> dict[str, str]:
    """Return the text of every file of the firmware by file name.

    Args:
        folder: name of the target folder; the main file of an Arduino sketch is named after it.
    """
    if board not in BOARDS:
        raise UnknownChoice("board", board, BOARDS)
    for label, name in (("device name", device_id), ("folder name for a sketch", folder)):
        if not _NAME.fullmatch(name):
            raise InputError(
                f"{name!r} is not a valid {label}; allowed: 1 to 32 letters, digits, - and _, "
                f"first a letter or digit"
            )
    values = {**_format_rig_numbers(board, rig), "DEVICE": device_id}
    values |= {"MCU": MCU, "F_CPU": str(CLOCK_HZ)}
    values |= {"UPLOAD_BAUD": str(UPLOAD_BAUD), "VERSION": __version__}
    files = {}
    for item in (resources.files("benchtool") / "library" / "sketch").iterdir():
        name = f"{folder}.ino" if item.name == "sketch.ino" else item.name
        text = item.read_text(encoding="utf-8")
        files[name] = re.sub(r"@([A-Z_]+)@", lambda match: values[match[1]], text)
    return dict(sorted(files.items()))


def _format_rig_numbers(board: str, rig: Rig) -> dict[str, str]:
    propulsion, limits = rig.propulsion, rig.limits
    if rig.n_rotors > MAX_MOTORS:
        raise InputError(
            f"rig {rig.name} has {rig.n_rotors} motors, but the timer of board {board} supports "
            f"{MAX_MOTORS}; use a rig with 1 or {MAX_MOTORS} rotors"
        )
    for name, pulse_us in (
        ("propulsion.pwm_stop_us", propulsion.pwm_stop_us),
        ("limits.pwm_us", limits.pwm_us),
    ):
        if not MIN_PULSE_US <= pulse_us <= MAX_PULSE_US:
            raise InputError(
                f"{name} of rig {rig.name} is {pulse_us:g} us; allowed for ESCs: "
                f"{MIN_PULSE_US:g} to {MAX_PULSE_US:g} us; correct the rig"
            )
    return {
        "BOARD": board,
        "RIG": rig.name,
        "MOTORS": str(rig.n_rotors),
        "PWM_STOP": f"{propulsion.pwm_stop_us:g}",
        "PWM_IDLE": f"{max(propulsion.pwm_stop_us, propulsion.pwm_start_us):g}",
        "LIMIT_PWM": f"{limits.pwm_us:g}",
        "LIMIT_THRUST": f"{min(limits.thrust_N, limits.load_cell_rating_N):g}",
        "LIMIT_RPM": f"{limits.rpm:g}",
        "LIMIT_VOLTAGE": f"{limits.voltage_min_V:g}",
    }
