"""What the bridge script of the RCbenchmark GUI says: lines of JSON to values, pure."""

from __future__ import annotations

import ipaddress
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import resources
from math import isfinite, nan
from typing import Annotated, Any, ClassVar

from annotated_types import Ge, Gt, Le

from benchtool import __version__
from benchtool.bench.serial.sketch_files import refuse_pulses_outside
from benchtool.core.channel import Channel
from benchtool.core.errors import FileFormatError, InputError, ProtocolError, UnknownChoice
from benchtool.core.parsed_text import parse_json
from benchtool.core.rig import Rig
from benchtool.core.toml_text import build
from benchtool.core.units import from_si, to_si, unit_named

BRIDGE_VERSION = 1
VIRTUAL_BOARD = "benchtool virtual stand"
"""How the board version of a virtual stand begins."""

LONGEST_LINE = 65536
LARGEST_SPEED = 1000.0
"""Most stand seconds per wall second that are accepted of a virtual stand."""

SPEED, PULSE = "rpm1", "pwm1_us"

CHANNELS: dict[str, Channel] = {
    "thrust": Channel("thrust_N", "N", "thrust of the load cell"),
    "torque": Channel("torque_Nm", "N m", "torque of the load cells"),
    "voltage": Channel("voltage_V", "V", "supply voltage"),
    "current": Channel("current_A", "A", "supply current"),
    "vibration": Channel("vibration_m_s2", "m/s2", "vibration of the stand"),
    # Only a virtual stand has a plate.
    "plateDistance": Channel("plate_z_m", "m", "distance of the plate"),
}
"""Channel of each reading by its name in the GUI, beside pulse and speed."""

FORCE_UNITS = {"g": "gf", "gf": "gf", "kg": "kgf", "kgf": "kgf", "n": "N", "lbf": "lbf"}
"""Our units for the GUI's words for thrust, in small letters; its documentation says g, and scripts
for the Series 1780 find kg."""

UNITS: dict[str, str] = FORCE_UNITS | {
    "n·m": "N m", "nm": "N m", "rpm": "rpm", "v": "V", "a": "A", "s": "s", "m": "m",
    "m/s2": "m/s2", "": "1",
}  # fmt: skip
"""Our units for the GUI's, in small letters; the `g` of vibration is an acceleration."""

STANDARD_GRAVITY_M_S2 = unit_named("kgf").factor

Pulse = Annotated[float, Ge(0.0), Le(1e4)]

Time = Annotated[float, Ge(0.0), Le(1e13)]

_FINITE: dict[str, Any] = {"allow_inf_nan": False}


@dataclass(frozen=True, slots=True, kw_only=True)
class BridgeEntry:
    """What the script itself says with every line.

    Attributes:
        t_ms: its own clock.
        us: the pulse that the output holds.
        n: number of these readings, None for an answer.
        to: the word that this answers.
        refused: why the word was refused, empty when it was not.
        why: why the script has stopped the motor, empty when it has not.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = _FINITE
    bridge: int
    t_ms: Time
    us: Pulse
    n: Annotated[int, Ge(0)] | None = None
    to: str = ""
    refused: str = ""
    why: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class BridgeHello(BridgeEntry):
    """The answer to a hello: which stand, which limits the script watches, when it stops."""

    __pydantic_config__: ClassVar[dict[str, Any]] = _FINITE
    board: str
    version: str
    firmware: str
    output: str
    speed: str
    low_us: Pulse
    high_us: Pulse
    silence_ms: Annotated[float, Gt(0.0), Le(1e5)]
    ramp_ms: Annotated[float, Ge(0.0), Le(1e5)]
    limits: Mapping[str, Annotated[float, Ge(0.0), Le(1e9)]]

    @property
    def is_virtual(self) -> bool:
        """Whether this comes from a stand of benchtool's, not the maker's."""
        return self.version.startswith(VIRTUAL_BOARD)


@dataclass(frozen=True, slots=True, kw_only=True)
class BridgeLine:
    """One line of the bridge.

    Attributes:
        values: readings by channel name, in the channel's unit; nan where there is none.
        time_s: the stand's own time of the readings, nan where there is none.
        plate_moves: whether the plate of a virtual stand is on its way.
        speed: stand seconds per wall second; 1 on every physical stand.
    """

    entry: BridgeEntry
    values: Mapping[str, float] = field(default_factory=dict)
    time_s: float = nan
    plate_moves: bool = False
    speed: float = 1.0


class BridgeDecoder:
    """Put bytes together to lines.

    Attributes:
        speed: reading that counts as the rotor's speed.
        foreign: lines of readings that did not come from the bridge script.
        corrupt: lines that were no JSON.
    """

    def __init__(self) -> None:
        self.speed = "motorOpticalSpeed"
        self.foreign = self.corrupt = 0
        self._rest = b""

    def feed(self, data: bytes) -> list[BridgeLine]:
        """Return the lines of the bridge that `data` completes.

        Raises:
            ProtocolError: another version of the script, or a reading in an unknown unit.
        """
        *lines, self._rest = (self._rest + data).split(b"\n")
        if self._rest.endswith(b"}"):
            # The maker's own example sends an object without an end of line.
            lines, self._rest = [*lines, self._rest], b""
        self._rest = self._rest[-LONGEST_LINE:]
        return [line for text in lines if (line := self._line(text)) is not None]

    def _line(self, text: bytes) -> BridgeLine | None:
        if not text.strip():
            return None
        try:
            # The GUI's helper cuts every letter to a byte: the degree sign comes as Latin 1.
            parsed = parse_json(text.decode("latin-1"), "a line of the bridge script")
        except FileFormatError:
            self.corrupt += 1
            return None
        entry = parsed.get("benchtool") if isinstance(parsed, dict) else None
        if not isinstance(entry, dict):
            self.foreign += isinstance(parsed, dict)
            self.corrupt += not isinstance(parsed, dict)
            return None
        if entry.get("bridge") != BRIDGE_VERSION:
            raise ProtocolError(
                f"the bridge script in the GUI has version {entry.get('bridge')}, this program "
                f"needs {BRIDGE_VERSION}; write it anew with benchtool bench bridge"
            )
        kind = BridgeHello if entry.get("to") == "hello" else BridgeEntry
        try:
            read = build(kind, entry, "the bridge script's line")
        except InputError as error:
            raise ProtocolError(f"{error}; write it anew with benchtool bench bridge") from error
        if read.n is None:
            return BridgeLine(entry=read)
        values = {
            channel.name: _reading(parsed, name, channel.unit) for name, channel in CHANNELS.items()
        }
        values[SPEED] = _reading(parsed, self.speed, "rpm")
        values[PULSE] = read.us
        speed = _reading(parsed, "simulationSpeed", "1")
        return BridgeLine(
            entry=read,
            values=values,
            time_s=_reading(parsed, "time", "s"),
            plate_moves=_reading(parsed, "plateMoving", "1") == 1.0,
            speed=speed if 0.0 < speed <= LARGEST_SPEED else 1.0,
        )


def _reading(parsed: Mapping[str, Any], name: str, unit: str) -> float:
    """Return one reading in a channel's unit, nan where there is none; refuse other units."""
    entry = parsed.get(name)
    value = entry.get("workingValue") if isinstance(entry, dict) else None
    if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
        return nan
    unit_text = str(entry.get("workingUnit", "")) if isinstance(entry, dict) else ""
    if name == "vibration" and unit_text.lower() == "g":
        return value * STANDARD_GRAVITY_M_S2
    ours = UNITS.get(unit_text.lower())
    if ours is None or unit_named(ours).dimension != unit_named(unit).dimension:
        raise ProtocolError(
            f"the stand reports {name} in {unit_text!r}, which is no known unit of it; known: "
            f"{', '.join(sorted(UNITS))}"
        )
    return from_si(to_si(float(value), ours), unit)


def pulse_text(pulse_us: float) -> bytes:
    """Return a pulse as the bridge takes it: ASCII, microseconds."""
    return f"{pulse_us:.7g}".encode("ascii")


class StandClock:
    """Give each reading a device time that never runs backwards, us.

    A stand's time begins anew with every log, and two readings can carry the same one; the
    script's own clock says how much has passed then.
    """

    def __init__(self) -> None:
        self._last_us = 0
        self._stand_s = nan
        self._script_ms = nan

    def time_us(self, stand_s: float, script_ms: float) -> int:
        """Return the device time of a reading by the stand's clock (nan: none), or the script's."""
        step_us = 1e6 * (stand_s - self._stand_s)
        if not step_us > 0.0:
            step_us = 1e3 * (script_ms - self._script_ms)
        self._stand_s, self._script_ms = stand_s, script_ms
        self._last_us += max(round(step_us), 1) if isfinite(step_us) else 1
        return self._last_us


FILE_NAME = "rcbudp_bridge.js"
LOOPBACK = "127.0.0.1"
GUI_PORT, HOST_PORT = 55047, 64126
"""Ports of the maker's own UDP example: where the GUI listens, and where it sends to."""

SILENCE_MS, RAMP_MS = 250, 500
"""Silence after which the script brings the motor down, as on every bench, and how long that takes:
supplies that take no current back (the API's own warning) are spared a sudden stop. Choices."""

SPEEDS = {"optical": "motorOpticalSpeed", "electrical": "motorElectricalSpeed"}
"""Readings of the GUI that give a speed: of its optical probe, or of the motor's wires."""

SHORTEST_US, LONGEST_US = 700.0, 2300.0
"""Pulses that the GUI puts out; anything else switches the output off (scripting API)."""


def bridge_text(
    rig: Rig,
    speed: str = "optical",
    *,
    listen_port: int = GUI_PORT,
    host: str = LOOPBACK,
    host_port: int = HOST_PORT,
) -> str:
    """Return the script with the numbers of a rig filled in.

    Args:
        speed: which reading counts as the rotor's speed, one of `SPEEDS`.
        listen_port: of the script.
        host: address of the computer that benchtool runs on, as the GUI's computer sees it.
        host_port: where benchtool listens.
    """
    if speed not in SPEEDS:
        raise UnknownChoice("speed reading", speed, SPEEDS)
    pulse, limits = rig.propulsion, rig.limits
    if rig.n_rotors != 1:
        raise InputError(
            f"rig {rig.name} has {rig.n_rotors} rotors, and the bridge drives one ESC; take a rig "
            f"with one rotor, for example pquad_single"
        )
    range_us = f"the GUI puts out {SHORTEST_US:g} to {LONGEST_US:g} us"
    refuse_pulses_outside(rig, SHORTEST_US, LONGEST_US, range_us)
    for what, port in (("GUI", listen_port), ("benchtool", host_port)):
        if not 0 < port < 65536:
            raise InputError(f"the port of {what} is {port}, outside 1 to 65535; choose one in it")
    try:
        ipaddress.IPv4Address(host)
    except ValueError:
        raise InputError(
            f"{host!r} is no IPv4 address; give the address of the computer that benchtool runs "
            f"on, {LOOPBACK} when the GUI runs there as well"
        ) from None
    if listen_port == host_port and host == LOOPBACK:
        raise InputError(
            f"GUI and benchtool cannot both listen on port {host_port} of one computer; choose "
            f"two ports, for example {GUI_PORT} and {HOST_PORT}"
        )
    watched = {
        "thrust_N": min(limits.thrust_N, limits.load_cell_rating_N),
        "rpm": limits.rpm,
        "current_A": limits.current_A,
        "voltage_min_V": limits.voltage_min_V,
    }
    filled = {
        "VERSION": __version__,
        "RIG": rig.name,
        "LISTEN_PORT": str(listen_port),
        "HOST": host,
        "HOST_PORT": str(host_port),
        "SPEED": SPEEDS[speed],
        "LOWEST_US": f"{pulse.pwm_stop_us:g}",
        "HIGHEST_US": f"{limits.pwm_us:g}",
        "LIMITS": json.dumps(watched),
        "SILENCE_MS": str(SILENCE_MS),
        "RAMP_MS": str(RAMP_MS),
        "FORCE_N": json.dumps({word: unit_named(u).factor for word, u in FORCE_UNITS.items()}),
    }
    source = resources.files("benchtool") / "library" / "bridge" / FILE_NAME
    return re.sub(
        r"@([A-Z_]+)@", lambda found: filled[found[1]], source.read_text(encoding="utf-8")
    )
