"""Compare where the plate was sent, where its stage says it stands, and what the bench reads. Pure.

A position is believed only where it is measured: a stage that counts its own steps cannot know that
it lost some, and a position channel may be frozen.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite, nan

import numpy as np
from numpy.typing import NDArray

from benchtool.core.channel import Channel
from benchtool.core.errors import StageError
from benchtool.core.rig import Rig, Sensor

CHANNEL = "plate_z_m"

LEAST_M = 0.001
"""Distances closer than this count as one, with a perfect drive and sensor too. A choice: at the
nearest plates of the rigs shipped, 1 mm changes thrust by less than 2 percent."""

NOISES = 4.0
"""Standard deviations of the sensor that one reading may be off."""


def plate_tolerance_m(rig: Rig) -> float:
    """Return how far a reading may be from where the plate stands: play, quantum and noise."""
    sensor = rig.sensors.get(CHANNEL, Sensor())
    return LEAST_M + rig.plate.backlash_m + sensor.quantum + NOISES * sensor.noise


class PlateCheck:
    """Judge the plate of one bench by what its position channel reads.

    Attributes:
        measured: whether the stream has a position channel.
        read_m: the last reading, nan before the first.
        tolerance_m: how far apart two positions may be.

    Args:
        channels: (c,) of the stream.
        rig: play, sensor and least gap.
    """

    def __init__(self, channels: Sequence[Channel], rig: Rig) -> None:
        names = [channel.name for channel in channels]
        self.measured = CHANNEL in names
        self.read_m = nan
        self.tolerance_m = plate_tolerance_m(rig)
        self._column = names.index(CHANNEL) if self.measured else -1
        self._rig = rig
        self._before_m = nan

    def note(self, values: NDArray[np.float64]) -> None:
        """Take the readings of samples (m, c), in channel order."""
        if self.measured:
            present = values[np.isfinite(values[:, self._column]), self._column]
            if len(present):
                self.read_m = float(present[-1])

    def departs(self) -> None:
        """Note that the plate is about to move."""
        self._before_m = self.read_m

    def arrives(self) -> None:
        """Note that the plate is said to have arrived: only later readings count."""
        self.read_m = nan

    def problem(self, target_m: float, stage_m: float, more_m: float = 0.0) -> StageError | None:
        """Return what is wrong with where the plate stands after a move, None when all agrees.

        Args:
            target_m: where it was sent.
            stage_m: where what moves it says that it stands.
            more_m: allowed on top of the tolerance, for a position that a person measured.
        """
        if not self.measured:
            return None
        allowed_m = self.tolerance_m + more_m
        after = f"after the move to {target_m:.4g} m"
        least_m = self._rig.plate.z_min_m
        if not isfinite(self.read_m):
            return StageError(
                f"{CHANNEL} brought no reading {after}, so where the plate stands is not known; "
                f"check the position sensor and its cable"
            )
        if self.read_m < least_m - self.tolerance_m:
            return StageError(
                f"{CHANNEL} reads {self.read_m:.4f} m {after}, inside the least gap of {least_m:g} "
                f"m of rig {self._rig.name!r}; move the plate away by hand, then check stage and "
                f"sensor"
            )
        if abs(self.read_m - stage_m) <= allowed_m:
            return None
        said = "" if stage_m == target_m else f", the stage says {stage_m:.4f} m"
        limit = f"tolerance {1e3 * allowed_m:.1f} mm"
        if abs(self.read_m - self._before_m) <= allowed_m < abs(target_m - self._before_m):
            return StageError(
                f"{CHANNEL} still reads {self.read_m:.4f} m {after}{said}, {limit}: the plate did "
                f"not move or its position channel is frozen; look at both before motors turn"
            )
        return StageError(
            f"{CHANNEL} reads {self.read_m:.4f} m {after}{said}, {limit}; home the stage and "
            f"measure the distance by hand, then correct zero, sensor or the rig's "
            f"sensors.{CHANNEL} (noise, quantum)"
        )

    def crept(self, stage_m: float, mean_m: float, more_m: float = 0.0) -> StageError | None:
        """Return an error when the mean reading of a point is not where the stage stands."""
        if not self.measured or abs(mean_m - stage_m) <= self.tolerance_m + more_m:
            return None
        if not isfinite(mean_m):
            return StageError(
                f"{CHANNEL} brought no reading during the point at {stage_m:.4g} m; check the "
                f"position sensor and its cable"
            )
        return StageError(
            f"the plate moved while motors turned: {CHANNEL} reads {mean_m:.4f} m on average at "
            f"{stage_m:.4f} m, tolerance {1e3 * (self.tolerance_m + more_m):.1f} mm; look at what "
            f"holds the plate"
        )
