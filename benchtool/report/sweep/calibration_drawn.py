"""The calibration that a run or a file holds, as a figure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from benchtool.report.page import Figure
from benchtool.report.sweep.calibration import CalibrationPoints, calibration_figure


def calibration_drawn(calibration: Mapping[str, Any], *, simulated: bool) -> Figure:
    """Draw the masses of a calibration against its counts, and what the line leaves over.

    Args:
        calibration: as its JSON file and a run's metadata hold it.
        simulated: the load cell was a virtual one.
    """
    newtons_per_kg = calibration["gravity_m_s2"] / calibration["lever_ratio"]
    force_N = np.array(calibration["masses_kg"], float) * newtons_per_kg
    return calibration_figure(
        CalibrationPoints(
            force_N=force_N,
            counts=np.array(calibration["counts"], float),
            calibrated_N=force_N + np.array(calibration["residuals_N"], float),
            loading=np.arange(len(force_N)) <= int(force_N.argmax()),
        ),
        title=f"Calibration {calibration['id']}",
        simulated=simulated,
    )
