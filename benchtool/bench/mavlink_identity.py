"""What a bench behind an autopilot says of itself. Pure."""

from __future__ import annotations

from collections.abc import Mapping

from benchtool.bench.bench import Identity
from benchtool.bench.mavlink_learn import Learnt
from benchtool.bench.mavlink_pilots import TIMEOUT_S
from benchtool.bench.mavlink_settings import MavlinkSettings
from benchtool.core.channel import Channel

ALONE = {"rotors_together": 1.0}
"""Limit of an autopilot whose motor test turns one motor at a time."""


def identity_of(
    address: str,
    learnt: Learnt,
    settings: MavlinkSettings,
    channels: tuple[Channel, ...],
    rate_Hz: float,
    more: Mapping[str, str],
) -> Identity:
    """Return the identity of an open bench.

    Args:
        address: as the user gave it.
        learnt: what the autopilot said.
        settings: what the address says.
        channels: those that live.
        rate_Hz: of the outputs.
        more: facts of the link.
    """
    pulses = learnt.pulses
    facts = {
        "autopilot": learnt.pilot.name,
        "pwm_stop_us": f"{pulses.stop_us:g}",
        "pwm_idle_us": f"{pulses.idle_us:g}",
        "motors": " ".join(map(str, learnt.wiring.motors)),
        "outputs": " ".join(str(output or "?") for output in learnt.wiring.outputs),
        **more,
    }
    if learnt.speed != 1.0:
        facts["speed"] = f"{learnt.speed:g}"
    if settings.mode == "pitch":
        facts["mode"] = "pitch"
    if settings.warning:
        facts["warning"] = settings.warning
    return Identity(
        address=address,
        device_id=learnt.device_id,
        firmware=learnt.firmware,
        protocol="MAVLink 2",
        channels=channels,
        rate_Hz=rate_Hz,
        n_rotors=learnt.wiring.n_rotors,
        simulated=learnt.simulated,
        moves_plate=learnt.simulated,
        limits={"pwm_us": pulses.high_us, **({} if learnt.pilot.together else ALONE)},
        watchdog_s=TIMEOUT_S,
        facts=facts,
    )
