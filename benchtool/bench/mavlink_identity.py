"""What a bench behind an autopilot says of itself. Pure."""

from __future__ import annotations

from collections.abc import Mapping

from benchtool.bench.bench import Identity
from benchtool.bench.mavlink_learn import Learnt
from benchtool.bench.mavlink_outputs import SEEN_S
from benchtool.bench.mavlink_pilots import TIMEOUT_S
from benchtool.bench.mavlink_settings import MavlinkSettings
from benchtool.core.channel import Channel

ALONE = {"rotors_together": 1.0}
"""Limit of an autopilot whose motor test turns one motor at a time."""

UNMAPPED = (
    "the address has no map=, so rotor 1 is taken to hang on output 1 and so on; where it does "
    "not, pulses and speeds are recorded under other rotors than theirs; make a map with benchtool "
    "bench map and add map=FILE"
)
"""Said of a pitch bench: its loop turns all rotors together, so that none shows its output."""


def identity_of(
    address: str,
    learnt: Learnt,
    settings: MavlinkSettings,
    channels: tuple[Channel, ...],
    rate_Hz: float,
    slowest_s: float,
    more: Mapping[str, str],
) -> Identity:
    """Return the identity of an open bench.

    Args:
        address: as the user gave it.
        learnt: what the autopilot said.
        settings: what the address says.
        channels: those that live.
        rate_Hz: of the outputs.
        slowest_s: longest time that an acknowledgement took (wall time).
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
        facts |= {"mode": "pitch", "armed_by": settings.arm}
    outputs = learnt.wiring.outputs
    unmapped = settings.mode == "pitch" and len(outputs) > 1 and 0 in outputs
    warnings = [settings.warning, UNMAPPED if unmapped else ""]
    if warning := "; ".join(filter(None, warnings)):
        facts["warning"] = warning
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
        has_loop=settings.mode == "pitch",
        armed_by_operator=settings.mode == "pitch" and settings.arm == "operator",
        pwm_stop_us=pulses.stop_us,
        pwm_idle_us=pulses.idle_us,
        outputs_measured=True,
        longest_delay_s=learnt.speed * max(slowest_s, SEEN_S),
        speed=learnt.speed,
        facts=facts,
    )
