"""What is checked of each kind of channel: one table for the guard and for the visits of a sweep.

Outliers are left out of the mean of every channel alike, and every channel whose noise a rig
states is found when it repeats one number; the table says what differs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import inf

from benchtool.core.rig import Limits

SLOW_CHANNEL_RATE_HZ = (
    10.0  # voltage, current and temperature may be silent this much longer than thrust and rpm
)


@dataclass(frozen=True, slots=True)
class ChannelChecks:
    """Say what is checked of one kind of channel.

    Attributes:
        limits: give the least and the greatest reading; the guard watches no channel without them.
        advice: what to do about a reading beyond.
        silence: multiple of the guard's `stale_s` for which it may bring no new value.
        needed: a visit in which it is short, late or frozen is measured again; of other channels
            an event says so.
        follows: it changes with the pulses and with the other channels that do.
    """

    limits: Callable[[Limits], tuple[float, float]] | None = None
    advice: str = ""
    silence: float = SLOW_CHANNEL_RATE_HZ
    needed: bool = False
    follows: bool = False


def _thrust(limits: Limits) -> tuple[float, float]:
    most_N = min(limits.thrust_N, limits.load_cell_rating_N)
    return -most_N, most_N


CHECKS: dict[str, ChannelChecks] = {  # by kind of channel: its name without the rotor's number
    "thrust_N": ChannelChecks(
        _thrust,
        "lower the plan's pwm or raise limits.thrust_N within the load cell's rating",
        silence=1.0,
        needed=True,
        follows=True,
    ),
    "thrust_raw": ChannelChecks(needed=True, follows=True),
    "rpm": ChannelChecks(
        lambda limits: (-inf, limits.rpm),
        "lower the plan's pwm or raise limits.rpm",
        silence=1.0,
        needed=True,
        follows=True,
    ),
    "torque_Nm": ChannelChecks(follows=True),
    "voltage_V": ChannelChecks(lambda limits: (limits.voltage_min_V, inf), "charge the battery"),
    "current_A": ChannelChecks(
        lambda limits: (-inf, limits.current_A),
        "lower the plan's pwm or raise limits.current_A",
        follows=True,
    ),
    "temperature_degC": ChannelChecks(
        lambda limits: (-inf, limits.temperature_degC),
        "let the ESC cool down or lower the plan's pwm",
    ),
    "plate_z_m": ChannelChecks(),
}
