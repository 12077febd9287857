"""Settings of a `mavlink:` bench: target, and the message of each channel."""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Container
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Annotated

from annotated_types import Ge, Le, Len

from benchtool.bench.drivers import MavlinkAddress, parse_port_and_baud
from benchtool.core.channel import Channel
from benchtool.core.choices import ArmedBy, BenchMode
from benchtool.core.errors import FileFormatError, InputError
from benchtool.core.toml_text import FiniteTable, read_strict
from benchtool.core.user_file import read_file, read_text

THRUST_MESSAGES = ("NAMED_VALUE_FLOAT", "DEBUG_VECT", "DEBUG_FLOAT_ARRAY")

PITCH_CHANNELS = ("theta_rad", "gyro_rad_s", "theta_ref_rad")

_THRUST = re.compile(r"(?P<name>[^.\[\]]{1,10})(?:\.(?P<axis>[xyz])|\[(?P<index>\d{1,2})\])?")


@dataclass(frozen=True, slots=True)
class ThrustSource:
    """Message that carries thrust."""

    message: str = "NAMED_VALUE_FLOAT"
    name: str = "thrust"  # name of the value, at most ten letters, in all three kinds of message
    part: str = ""  # "x", "y" or "z" of a vector, the index in an array, "" for a single value

    @classmethod
    def parse(cls, text: str) -> ThrustSource:
        """Parse `thrust` (a single value), `cell.z` (of a vector) or `cells[2]` (of an array)."""
        match = _THRUST.fullmatch(text)
        if match is None:
            raise InputError(
                f"thrust={text!r} is not a valid name; write thrust=NAME, NAME.x or NAME[0], the "
                f"name at most 10 letters long"
            )
        if match["axis"]:
            return cls("DEBUG_VECT", match["name"], match["axis"])
        if match["index"]:
            return cls("DEBUG_FLOAT_ARRAY", match["name"], match["index"])
        return cls("NAMED_VALUE_FLOAT", match["name"])


NO_THRUST = ThrustSource(name="")  # no message, because the load cell is elsewhere


def build_channels(n_rotors: int) -> tuple[Channel, ...]:
    """Return all channels that an autopilot can report for so many rotors, in order."""
    numbers = range(1, n_rotors + 1)
    return (
        *(Channel(f"pwm{i}_us", "pwm_us", f"output that drives rotor {i}") for i in numbers),
        *(Channel(f"rpm{i}", "rpm", f"speed of rotor {i}") for i in numbers),
        Channel("thrust_N", "N", "thrust since the tare, tared by the host"),
        Channel("thrust_raw", "count", "value of the load cell's message, never tared"),
        Channel("plate_z_m", "m", "distance sensor"),
        Channel("voltage_V", "V", "battery voltage"),
        Channel("current_A", "A", "battery current"),
        Channel("temperature_degC", "degC", "hottest ESC"),
        Channel("theta_rad", "rad", "pitch, positive nose down"),
        Channel("gyro_rad_s", "rad/s", "pitch rate, positive nose down"),
        Channel("theta_ref_rad", "rad", "reference pitch, positive nose down"),
    )


def live_channels(
    mode: BenchMode, n_rotors: int, live: Container[int], *, cell: bool
) -> dict[int, Channel]:
    """Return the channels of a bench by their columns."""
    # Attitude may be streamed for another host and does not make a pitch bench.
    # Where a router asks for attitude, the bench is no pitch bench.
    excluded = PITCH_CHANNELS if mode == "plate" else ()
    always = ("thrust_N", "thrust_raw") if cell else ()
    return {
        column: channel
        for column, channel in enumerate(build_channels(n_rotors))
        if channel.name in always
        or ((column < n_rotors or column in live) and channel.name not in excluded)
    }


MotorNumber = Annotated[int, Ge(1), Le(12)]

OutputNumber = Annotated[int, Ge(0), Le(16)]


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorMap(FiniteTable):
    """Motor, output and ESC of each rotor, in the rig's order."""

    rig: str
    autopilot: str
    # Number of each rotor in the autopilot's motor test, from 1
    motors: Annotated[tuple[MotorNumber, ...], Len(1, 12)]
    outputs: tuple[OutputNumber, ...]  # output that drives each rotor; 0 if unknown
    escs: tuple[OutputNumber, ...]  # index of each rotor in speed messages; 0 if there is none

    @property
    def n_rotors(self) -> int:
        return len(self.motors)

    def to_toml(self) -> str:
        """Return the map as file text."""
        lines = ["# Made by `benchtool bench map`: rotors of the rig on an autopilot."]
        # JSON strings and lists of numbers are valid TOML, on one line.
        lines += [
            f"{name} = {json.dumps(value)}" for name, value in dataclasses.asdict(self).items()
        ]
        return "\n".join(lines) + "\n"


def read_motor_map(path: Path) -> MotorMap:
    """Read a motor map; raise if it is incomplete or inconsistent."""
    try:
        text = read_text(path)
    except FileFormatError as error:
        raise FileFormatError(
            f"the map of motors {error.where}",
            f"{error.problem}; make one with benchtool bench map",
        ) from error
    motor_map = read_strict(MotorMap, text, str(path))
    if not len(motor_map.motors) == len(motor_map.outputs) == len(motor_map.escs):
        raise FileFormatError(
            str(path), "motors, outputs and escs differ in length; give one of each per rotor"
        )
    if len(set(motor_map.motors)) < len(motor_map.motors):
        raise FileFormatError(str(path), "motors names one motor twice; each drives one rotor")
    return motor_map


KEY_BYTES = 32
MAX_KEY_BYTES = 4096  # longest pass phrase; assumed

# Default rates. A loop on board updates its outputs some hundred times a second; changes between
# reports turn the beam and look like a disturbance.
RATE_HZ, PITCH_HZ = 50.0, 250.0


@dataclass(frozen=True, slots=True, kw_only=True)
class MavlinkSettings:
    """Settings of the link to an autopilot and of its channels."""

    system: int | None = None
    rotors: int | None = None
    # Map of the rig; None assigns rotors to motors 1, 2, ... with unknown outputs
    motor_map: MotorMap | None = None
    mode: BenchMode = "plate"
    arm: ArmedBy = "operator"  # who arms in a pitch experiment
    rate_Hz: float = RATE_HZ
    key: bytes | None = None  # 32 bytes for MAVLink 2 signing; None disables signing
    thrust: ThrustSource = ThrustSource()  # the default of a script
    thrust_scale_N: float = 1.0  # newtons per unit of the thrust message
    speeds: bool = True
    # Of the distance sensor that faces the plate (MAV_SENSOR_ORIENTATION), others are ignored; None
    # disables the distance
    orientation: int | None = None
    # Port and baud rate of an auxiliary load cell; None if there is none
    cell: tuple[str, int] | None = None
    warning: str = ""  # shown before the link is opened, or empty


def parse_settings(address: MavlinkAddress) -> MavlinkSettings:
    """Return the settings of an address, with the contents of its map and key files."""
    is_pitch = address.mode == "pitch"
    has_distance = (address.distance or ("on" if is_pitch else "off")) == "on"
    return MavlinkSettings(
        system=address.system,
        rotors=address.rotors,
        motor_map=None if address.map is None else read_motor_map(address.map),
        mode=address.mode,
        arm=address.arm,
        rate_Hz=address.rate_Hz or (PITCH_HZ if is_pitch else RATE_HZ),
        key=None if address.key is None else read_key(address.key),
        thrust=ThrustSource.parse(address.thrust),
        thrust_scale_N=address.thrust_scale_N,
        speeds=address.rpm == "auto",
        orientation=address.orientation if has_distance else None,
        cell=parse_port_and_baud(address.cell, address.text) if address.cell else None,
        warning=address.warning,
    )


def read_key(path: Path) -> bytes:
    """Read a signing key: 32 bytes, 64 hexadecimal digits, or a pass phrase (its SHA-256)."""
    data = read_file(path, MAX_KEY_BYTES)
    if len(data) == KEY_BYTES:
        return data
    text = data.strip()
    if not text:
        raise InputError(f"the key {path} is empty; give 32 bytes, 64 hexadecimal digits or a "
                         f"pass phrase")  # fmt: skip
    if re.fullmatch(rb"[0-9A-Fa-f]{64}", text):
        return bytes.fromhex(text.decode())
    return sha256(text).digest()
