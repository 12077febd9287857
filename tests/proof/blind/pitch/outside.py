"""Effects that no library names: what an honest tool calls unknown.

Full ones are sized so that a bench model without them misses the motion by more than the bench's
own noise does (`gap.py` measures it, a test states it); weak ones are smaller. All sizes are ours.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tests.proof.blind.families import Stage, Strength
from tests.proof.blind.pitch.plant import Plant

WEAK = 0.25  # size of a weak effect in a full one's

Outside = Callable[[np.random.Generator, Plant, float], Plant]


def stribeck_hysteresis(rng: np.random.Generator, plant: Plant, scale: float) -> Plant:
    """Give the hinge bristles: it holds more at rest than in motion, and remembers."""
    coulomb = scale * rng.uniform(0.008, 0.014)
    return replace(
        plant,
        friction_Nm=0.0,
        bristle_coulomb_Nm=coulomb,
        bristle_static_Nm=coulomb * rng.uniform(3.0, 4.5),
        bristle_rate_rad_s=rng.uniform(0.1, 0.3),
        bristle_angle_rad=math.radians(rng.uniform(0.5, 2.0)),
    )


def arm_flexure(rng: np.random.Generator, plant: Plant, scale: float) -> Plant:
    """Let hub and arms swing against each other; encoder and gyro sit on the hub."""
    share = rng.uniform(0.3, 0.5)
    frequency_Hz = rng.uniform(8.0, 11.0) / math.sqrt(scale)
    between = share * (1.0 - share) * plant.inertia_kgm2
    omega = 2.0 * math.pi * frequency_Hz
    return replace(
        plant,
        flex_hub_share=share,
        flex_Nm_per_rad=between * omega**2,
        flex_damping_Nms=2.0 * rng.uniform(0.2, 0.3) * between * omega,
    )


def encoder_backlash(rng: np.random.Generator, plant: Plant, scale: float) -> Plant:
    """Give the coupling between hinge and encoder play."""
    return replace(plant, encoder_play_rad=scale * math.radians(rng.uniform(0.8, 1.8)))


def esc_steps(rng: np.random.Generator, plant: Plant, scale: float) -> Plant:
    """Let the ESC answer only to every so many microseconds."""
    return replace(plant, esc_step_us=scale * rng.uniform(16.0, 40.0))


def thrust_lean(rng: np.random.Generator, plant: Plant, scale: float) -> Plant:
    """Let a rotor pull more while it speeds up than while it slows down, at one speed."""
    return replace(
        plant,
        thrust_lean=scale * float(rng.choice([-1.0, 1.0])) * rng.uniform(0.04, 0.1),
        thrust_lean_rpm_per_s=rng.uniform(1500.0, 4000.0),
    )


def shifting_load(rng: np.random.Generator, plant: Plant, scale: float) -> Plant:
    """Let a loose load creep along the beam some time during the recording."""
    return replace(
        plant,
        load_shift_Nm=scale * float(rng.choice([-1.0, 1.0])) * rng.uniform(0.02, 0.05),
        load_time_s=rng.uniform(8.0, 22.0),
        load_width_s=rng.uniform(3.0, 10.0),
    )


def rubber_bumper(rng: np.random.Generator, plant: Plant, scale: float) -> Plant:
    """Let the beam lean on a piece of rubber beyond an angle."""
    return replace(
        plant,
        bumper_Nm_per_rad=scale * rng.uniform(0.25, 0.6),
        bumper_rad=math.radians(rng.uniform(4.0, 9.0)),
    )


def drag_vane(rng: np.random.Generator, plant: Plant, scale: float) -> Plant:
    """Let something broad turn with the beam: a torque that grows with the rate squared."""
    return replace(plant, vane_Nms2=scale * rng.uniform(0.015, 0.04))


def fading_rotor(rng: np.random.Generator, plant: Plant, scale: float) -> Plant:
    """Let rotor 1 lose thrust at one speed while it warms up."""
    return replace(plant, fade=scale * rng.uniform(0.02, 0.06), fade_s=rng.uniform(4.0, 12.0))


def flutter_band(rng: np.random.Generator, plant: Plant, scale: float) -> Plant:
    """Let both rotors pull more, or less, in a band of speeds."""
    return replace(
        plant,
        flutter=scale * float(rng.choice([-1.0, 1.0])) * rng.uniform(0.03, 0.08),
        flutter_rpm=rng.uniform(5700.0, 6400.0),
        flutter_width_rpm=rng.uniform(150.0, 400.0),
    )


def jet_from_plate(rng: np.random.Generator, plant: Plant, scale: float) -> Plant:
    """Let the covered rotor gain thrust near the plate by another law, beside the images."""
    return replace(
        plant, near_gain=scale * rng.uniform(0.12, 0.25), near_length=rng.uniform(0.35, 0.8)
    )


OUTSIDE: dict[str, Outside] = {
    draw.__name__: draw
    for draw in (
        stribeck_hysteresis,
        arm_flexure,
        encoder_backlash,
        esc_steps,
        thrust_lean,
        shifting_load,
        rubber_bumper,
        drag_vane,
        fading_rotor,
        flutter_band,
        jet_from_plate,
    )
}

STAGES: dict[str, Stage] = {
    "stribeck_hysteresis": "hinge",
    "arm_flexure": "hinge",
    "encoder_backlash": "sensor",
    "esc_steps": "pwm_to_rpm",
    "thrust_lean": "rpm_to_thrust",
    "shifting_load": "hinge",
    "rubber_bumper": "hinge",
    "drag_vane": "hinge",
    "fading_rotor": "rpm_to_thrust",
    "flutter_band": "rpm_to_thrust",
    "jet_from_plate": "rpm_to_thrust",
}


def put_outside(name: str, rng: np.random.Generator, plant: Plant, strength: Strength) -> Plant:
    """Return the plant with an effect from outside the library."""
    return OUTSIDE[name](rng, plant, WEAK if strength == "weak" else 1.0)


def without_outside(plant: Plant) -> Plant:
    """Return the plant as a library could at best describe it: friction in motion kept."""
    return replace(
        plant,
        friction_Nm=plant.friction_Nm + plant.bristle_coulomb_Nm,
        bristle_coulomb_Nm=0.0,
        bristle_static_Nm=0.0,
        flex_Nm_per_rad=0.0,
        encoder_play_rad=0.0,
        esc_step_us=0.0,
        thrust_lean=0.0,
        load_shift_Nm=0.0,
        bumper_Nm_per_rad=0.0,
        vane_Nms2=0.0,
        fade=0.0,
        flutter=0.0,
        near_gain=0.0,
    )
