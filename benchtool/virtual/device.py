"""The virtual bench as a device: a plant of simulated physics and what it says of itself."""

from __future__ import annotations

import numpy as np

from benchtool import __version__
from benchtool.bench.serial.hello import Hello
from benchtool.core.rig import Rig
from benchtool.physics.model import Model
from benchtool.simulate.imperfections import Imperfections
from benchtool.simulate.plate_bench import PlateBench

IDLE_SHARE = 0.05
"""Share of the pulse range that counts as idle; an assumption: motors turn slowly or not at all."""


def virtual_plant(
    rig: Rig,
    truth: Model,
    seed: int,
    imperfections: Imperfections | None = None,
    rate_Hz: float = 200.0,
) -> PlateBench:
    """Return the simulated physics of a rig, its random numbers from `seed`."""
    return PlateBench(rig, truth, np.random.default_rng(seed), imperfections, rate_Hz)


def hello_of(plant: PlateBench, truth: Model, seed: int) -> Hello:
    """Return what the virtual device of that plant says of itself."""
    rig = plant.rig
    pulse = rig.propulsion
    start_us = max(pulse.pwm_stop_us, pulse.pwm_start_us)
    return Hello(
        device_id=f"virtual-{rig.name}-{seed}",
        firmware=f"benchtool virtual bench {__version__}",
        n_rotors=rig.n_rotors,
        channels=plant.channels,
        channel_rates_Hz=plant.channel_rates_Hz,
        rate_Hz=plant.rate_Hz,
        limits=device_limits(rig),
        pwm_stop_us=pulse.pwm_stop_us,
        pwm_idle_us=start_us + IDLE_SHARE * (pulse.pwm_max_us - start_us),
        # Whatever moves the plate of the real rig, nobody else can move that of a virtual one.
        moves_plate=True,
        simulated=True,
        facts={
            "rig": rig.name,
            "truth": truth.name,
            "seed": str(seed),
            "thrust_raw_N_per_count": f"{plant.count_N:.9g}",
        },
    )


def device_limits(rig: Rig) -> dict[str, float]:
    """Return the limits that a device of this rig guards by itself, by name."""
    limits = rig.limits
    return {
        "pwm_us": limits.pwm_us,
        "thrust_N": min(limits.thrust_N, limits.load_cell_rating_N),
        "rpm": limits.rpm,
        "current_A": limits.current_A,
        "voltage_min_V": limits.voltage_min_V,
        "temperature_degC": limits.temperature_degC,
        "plate_z_min_m": rig.plate.z_min_m,
        "plate_z_max_m": rig.plate.z_max_m,
        "plate_x_max_m": rig.plate_x_max_m,
    }
