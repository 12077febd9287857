"""The virtual pitch bench in the same process, on a virtual clock: `sim:RIG?mode=pitch`."""

from __future__ import annotations

from benchtool.virtual.pitch_device import pitch_hello
from benchtool.virtual.pitch_plant import PitchPlant
from benchtool.virtual.simulated import SimulatedBench

LOOK_S = 0.02
"""The device looks at its limits so often, because a beam turns quickly. A choice, five ticks."""


class SimulatedPitch(SimulatedBench):
    """Answer as a pitch bench does, without waiting.

    Args:
        address: as the user gave it.
        plant: bench, controller and schedule.
        seed: of the plant's noise.
    """

    def __init__(self, address: str, plant: PitchPlant, seed: int = 0) -> None:
        self._power_up(address, plant, pitch_hello(plant, seed), LOOK_S)
