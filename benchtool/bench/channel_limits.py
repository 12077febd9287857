"""Checks per kind of channel, for the guard and for the points of a sweep.

Two checks apply to every channel: outliers are excluded from its mean, and a channel with a noise
in the rig is checked for a frozen value. The table contains the differences.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import inf

from benchtool.core.rig import Limits

SLOW_CHANNEL_RATE_HZ = 10.0  # factor on the silence limit of voltage, current and temperature


@dataclass(frozen=True, slots=True)
class ChannelChecks:
    """Checks of one kind of channel.

    Attributes:
        limits: returns the lowest and highest allowed reading; without it the guard checks nothing.
        advice: remedy for a reading outside the limits.
        silence_factor: multiple of the guard's `stale_s` allowed without a new value.
        is_required: a point whose channel is short, late or frozen is repeated; other channels
            only cause an event.
        follows_pulse_width: it changes with the pulse widths and with the other such channels.
    """

    limits: Callable[[Limits], tuple[float, float]] | None = None
    advice: str = ""
    silence_factor: float = SLOW_CHANNEL_RATE_HZ
    is_required: bool = False
    follows_pulse_width: bool = False


def _thrust(limits: Limits) -> tuple[float, float]:
    max_N = min(limits.thrust_N, limits.load_cell_rating_N)
    return -max_N, max_N


CHECKS: dict[str, ChannelChecks] = {  # by channel family: the name without the rotor number
    "thrust_N": ChannelChecks(
        _thrust,
        "lower the plan's pwm or raise limits.thrust_N within the load cell's rating",
        silence_factor=1.0,
        is_required=True,
        follows_pulse_width=True,
    ),
    "thrust_raw": ChannelChecks(is_required=True, follows_pulse_width=True),
    "rpm": ChannelChecks(
        lambda limits: (-inf, limits.rpm),
        "lower the plan's pwm or raise limits.rpm",
        silence_factor=1.0,
        is_required=True,
        follows_pulse_width=True,
    ),
    "torque_Nm": ChannelChecks(follows_pulse_width=True),
    "voltage_V": ChannelChecks(lambda limits: (limits.voltage_min_V, inf), "charge the battery"),
    "current_A": ChannelChecks(
        lambda limits: (-inf, limits.current_A),
        "lower the plan's pwm or raise limits.current_A",
        follows_pulse_width=True,
    ),
    "temperature_degC": ChannelChecks(
        lambda limits: (-inf, limits.temperature_degC),
        "let the ESC cool down or lower the plan's pwm",
    ),
    "plate_z_m": ChannelChecks(),
}
