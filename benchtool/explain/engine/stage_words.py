"""Links of the chain in the field's words, for tables and for sentences."""

from __future__ import annotations

STAGES = {
    "pwm_to_rpm": "from pwm to rpm",
    "rpm_to_thrust": "from rpm to thrust",
    "hinge": "hinge",
    "sensor": "sensor",
    "plate": "plate",
}
"""As a heading or a cell has them."""

PLACES = {
    "pwm_to_rpm": "between pulse and rotor speed",
    "rpm_to_thrust": "between rotor speed and thrust",
    "hinge": "at the hinge",
    "sensor": "in the sensors",
    "plate": "at the plate",
}
"""As a sentence says where something is."""


def stage_words(stage: str) -> str:
    """Return a link of the chain, or a channel, in words."""
    return STAGES.get(stage, stage)
