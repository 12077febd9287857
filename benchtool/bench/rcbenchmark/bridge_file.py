"""The bridge script for the RCbenchmark GUI: `bridge/rcbudp_bridge.js` with a rig's numbers."""

from __future__ import annotations

import ipaddress
import json
import re
from dataclasses import dataclass
from importlib import resources

from benchtool import __version__
from benchtool.bench.serial.esc_pulses import refuse_pulses_outside
from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.rig import Rig
from benchtool.core.units import unit_named

FILE_NAME = "rcbudp_bridge.js"

LOOPBACK = "127.0.0.1"
GUI_PORT, HOST_PORT = 55047, 64126
"""Ports of the maker's own UDP example: where the GUI listens, and where it sends to."""

SILENCE_MS, RAMP_MS = 250, 500
"""Silence after which the script brings the motor down, as on every bench, and how long that takes:
supplies that take no current back (the API's own warning) are spared a sudden stop. Choices."""

SPEEDS = {"optical": "motorOpticalSpeed", "electrical": "motorElectricalSpeed"}
"""Readings of the GUI that tell a speed: of its optical probe, or of the motor's wires."""

FORCE_UNITS = {"g": "gf", "gf": "gf", "kg": "kgf", "kgf": "kgf", "n": "N", "lbf": "lbf"}
"""Our units for the GUI's words for thrust, in small letters; its documentation says g, and scripts
for the Series 1780 find kg."""

SHORTEST_US, LONGEST_US = 700.0, 2300.0
"""Pulses that the GUI puts out; anything else switches the output off (scripting API)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BridgePlace:
    """Say between which ports the bridge stands.

    Attributes:
        listen_port: of the script.
        host: address of the computer that benchtool runs on, as the GUI's computer sees it.
        host_port: where benchtool listens.
    """

    listen_port: int = GUI_PORT
    host: str = LOOPBACK
    host_port: int = HOST_PORT


def bridge_text(rig: Rig, place: BridgePlace, speed: str = "optical") -> str:
    """Return the script with the numbers of a rig filled in.

    Args:
        rig: pulses and limits; a single rotor.
        place: ports and host.
        speed: which reading counts as the rotor's speed, one of `SPEEDS`.

    Raises:
        InputError, UnknownChoice: a rig or a place that no bridge can serve.
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
    _check_place(place)
    watched = {
        "thrust_N": min(limits.thrust_N, limits.load_cell_rating_N),
        "rpm": limits.rpm,
        "current_A": limits.current_A,
        "voltage_min_V": limits.voltage_min_V,
    }
    filled = {
        "VERSION": __version__,
        "RIG": rig.name,
        "LISTEN_PORT": str(place.listen_port),
        "HOST": place.host,
        "HOST_PORT": str(place.host_port),
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


def _check_place(place: BridgePlace) -> None:
    for what, port in (("GUI", place.listen_port), ("benchtool", place.host_port)):
        if not 0 < port < 65536:
            raise InputError(f"the port of {what} is {port}, outside 1 to 65535; choose one in it")
    try:
        ipaddress.IPv4Address(place.host)
    except ValueError:
        raise InputError(
            f"{place.host!r} is no IPv4 address; give the address of the computer that benchtool "
            f"runs on, {LOOPBACK} when the GUI runs there as well"
        ) from None
    if place.listen_port == place.host_port and place.host == LOOPBACK:
        raise InputError(
            f"GUI and benchtool cannot both listen on port {place.host_port} of one computer; "
            f"choose two ports, for example {GUI_PORT} and {HOST_PORT}"
        )
