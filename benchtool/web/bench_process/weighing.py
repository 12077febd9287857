"""Calibrate from the page: one mass after another, then a line through them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from datetime import datetime

import numpy as np

from benchtool.acquire.calibration import (
    Calibration,
    fit_calibration,
    mean_counts,
)
from benchtool.bench.bench import Bench
from benchtool.core.errors import InputError
from benchtool.core.rig import Rig
from benchtool.core.units import STANDARD_GRAVITY_M_S2
from benchtool.data.run.state import remember

LONGEST_S = 60.0


class Weighing:
    """Collect masses and raw counts of one device."""

    def __init__(self) -> None:
        self._weighed: list[tuple[float, float]] = []

    @property
    def weighed(self) -> tuple[tuple[float, float], ...]:
        """Masses in kg and counts so far."""
        return tuple(self._weighed)

    def forget(self) -> None:
        """Discard the masses so far."""
        self._weighed.clear()

    def weigh(self, bench: Bench, rig: Rig, mass_kg: float, seconds: float) -> None:
        """Average the counts under a mass.

        Raises:
            InputError: a mass beyond the load cell's rating, or a time that is none.
            CalibrationError: the device streams no counts.
        """
        rating_N = rig.limits.load_cell_rating_N
        if not 0.0 <= mass_kg * STANDARD_GRAVITY_M_S2 <= rating_N:
            raise InputError(
                f"{mass_kg:g} kg pull with {mass_kg * STANDARD_GRAVITY_M_S2:.3g} N, the load "
                f"cell's rating is {rating_N:g} N; take a mass from 0 on within it"
            )
        if not 0.0 < seconds <= LONGEST_S:
            raise InputError(
                f"an average of {seconds:g} s was asked for; give more than 0 and at most "
                f"{LONGEST_S:g} s"
            )
        self._weighed.append((mass_kg, mean_counts(bench, seconds).mean))

    def fit(self, device_id: str, now: Callable[[], datetime]) -> Calibration:
        """Return the calibration, stored for this device from now on.

        Raises:
            CalibrationError: too few masses, or counts that make no line.
        """
        table = np.array(self._weighed, float).reshape(-1, 2)
        calibration = fit_calibration(
            table[:, 0],
            table[:, 1],
            date=now().strftime("%Y-%m-%dT%H%M%S"),
            device_id=device_id,
        )
        remember("calibration", device_id, asdict(calibration))
        self.forget()
        return calibration
