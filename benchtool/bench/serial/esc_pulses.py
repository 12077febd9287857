"""Whether something that puts out pulses can put out those that a rig asks of its ESCs."""

from __future__ import annotations

from benchtool.core.errors import InputError
from benchtool.core.rig import Rig


def refuse_pulses_outside(rig: Rig, shortest_us: float, longest_us: float, why: str) -> None:
    """Refuse a rig whose pulses at rest or at its limit lie outside a range.

    Args:
        rig: pulses and limits.
        shortest_us: the least pulse that can be put out.
        longest_us: the greatest.
        why: the range in words.
    """
    for name, pulse_us in (
        ("propulsion.pwm_stop_us", rig.propulsion.pwm_stop_us),
        ("limits.pwm_us", rig.limits.pwm_us),
    ):
        if not shortest_us <= pulse_us <= longest_us:
            raise InputError(
                f"{name} of rig {rig.name} is {pulse_us:g} us, and {why}; correct the rig"
            )
