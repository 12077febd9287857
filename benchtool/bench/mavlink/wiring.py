"""Which message feeds which channel of the bench: outputs, ESCs, names of a load cell. Pure."""

from __future__ import annotations

import re
from dataclasses import dataclass

from benchtool.core.channel import Channel
from benchtool.core.errors import InputError

THRUST_MESSAGES = ("NAMED_VALUE_FLOAT", "DEBUG_VECT", "DEBUG_FLOAT_ARRAY")

PITCH_CHANNELS = ("theta_rad", "gyro_rad_s", "theta_ref_rad")

DOWN = 25
"""MAV_SENSOR_ROTATION_PITCH_270: a distance sensor that looks down, where the plate is."""

_THRUST = re.compile(r"(?P<name>[^.\[\]]{1,10})(?:\.(?P<axis>[xyz])|\[(?P<index>\d{1,2})\])?")


@dataclass(frozen=True, slots=True)
class ThrustSource:
    """Name the message that carries thrust.

    Attributes:
        message: one of `THRUST_MESSAGES`.
        name: of the value, at most ten letters; NAMED_VALUE_FLOAT and the others have one field.
        part: "x", "y" or "z" of a vector, the index in an array, "" for a single value.
    """

    message: str = "NAMED_VALUE_FLOAT"
    name: str = "thrust"
    part: str = ""

    @classmethod
    def named(cls, text: str) -> ThrustSource:
        """Read `thrust` (a single value), `cell.z` (of a vector) or `cells[2]` (of an array).

        Raises:
            InputError: it is none of these.
        """
        found = _THRUST.fullmatch(text)
        if found is None:
            raise InputError(
                f"thrust={text!r} names no value; write thrust=NAME, NAME.x or NAME[0], the name "
                f"at most 10 letters long"
            )
        if found["axis"]:
            return cls("DEBUG_VECT", found["name"], found["axis"])
        if found["index"]:
            return cls("DEBUG_FLOAT_ARRAY", found["name"], found["index"])
        return cls("NAMED_VALUE_FLOAT", found["name"])


THRUST = ThrustSource()
"""A single value called `thrust`: what a script or a companion sends unless told otherwise."""

NO_THRUST = ThrustSource(name="")
"""A name that no message has, for a load cell that hangs elsewhere."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Wiring:
    """Say how the rotors of a rig hang on an autopilot.

    Attributes:
        motors: (n_rotors,) number of each rotor in the autopilot's motor test, from 1.
        outputs: (n_rotors,) output that drives each rotor, from 1; 0 where it is not known.
        escs: (n_rotors,) place of each rotor in speed messages, from 1.
        thrust: message of the load cell.
        thrust_scale_N: newtons per unit of that message.
        orientation: of the distance sensor that looks at the plate; None takes no distance.
        virtual: whether the autopilot's world is virtual and knows the plate's distance exactly.
    """

    motors: tuple[int, ...]
    outputs: tuple[int, ...]
    escs: tuple[int, ...]
    thrust: ThrustSource = THRUST
    thrust_scale_N: float = 1.0
    orientation: int | None = None
    virtual: bool = False

    @property
    def n_rotors(self) -> int:
        """How many rotors there are."""
        return len(self.motors)


def channels_of(n_rotors: int) -> tuple[Channel, ...]:
    """Return everything that an autopilot can tell about so many rotors, in order."""
    numbers = range(1, n_rotors + 1)
    return (
        *(Channel(f"pwm{i}_us", "pwm_us", f"output that drives rotor {i}") for i in numbers),
        *(Channel(f"rpm{i}", "rpm", f"speed of rotor {i}") for i in numbers),
        Channel("thrust_N", "N", "thrust since the tare, tared by the host"),
        Channel("thrust_raw", "count", "what the load cell's message says, never tared"),
        Channel("plate_z_m", "m", "distance sensor"),
        Channel("voltage_V", "V", "battery voltage"),
        Channel("current_A", "A", "battery current"),
        Channel("temperature_degC", "degC", "hottest ESC"),
        Channel("theta_rad", "rad", "pitch, positive nose down"),
        Channel("gyro_rad_s", "rad/s", "pitch rate, positive nose down"),
        Channel("theta_ref_rad", "rad", "wanted pitch, positive nose down"),
    )
