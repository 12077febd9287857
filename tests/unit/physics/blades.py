"""Blades and a motor for tests, and rigs with them."""

from __future__ import annotations

from dataclasses import replace

from benchtool.core.rig import Blade, Motor, Rig
from benchtool.core.rig_file import load_rig_by_name

BLADE = Blade(solidity=0.10, lift_slope=5.7, pitch_rad=0.25, profile_drag=0.03)
MOTOR = Motor(Kv_rpm_V=920.0, resistance_ohm=0.12, no_load_current_A=0.5)


def bladed(name: str, motor: Motor | None = MOTOR) -> Rig:
    """Return a rig of the library with these blades and a motor."""
    return replace(load_rig_by_name(name), blade=BLADE, motor=motor)
