"""Flight with its measures, and as a recording."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from benchtool.core.channel import Channel
from benchtool.core.recording import Recording
from benchtool.simulate.controllers.laws import FLIGHT_CONTROLLERS
from benchtool.simulate.flight.environment import Environment
from benchtool.simulate.flight.flight import Flight, FlightCase, fly
from benchtool.simulate.flight.measures import Measures, measure


@dataclass(frozen=True, slots=True, eq=False)
class FlownCase:
    """Flight with its measures."""

    flight: Flight
    measures: Measures

    @property
    def case(self) -> FlightCase:
        """Case of the flight."""
        return self.flight.case


def fly_and_measure(case: FlightCase) -> FlownCase:
    """Fly a case and return the flight with its measures."""
    flight = fly(case)
    return FlownCase(flight, measure(flight))


def out_of_ground_effect(case: FlightCase) -> FlightCase:
    """Return the same case without surfaces and gyro noise."""
    return replace(case, below=Environment(), gyro_noise_rad_s=0.0)


def controller_label(flown: FlownCase) -> str:
    """Return the label of the controller in tables and figures."""
    return flown.flight.user_controller or FLIGHT_CONTROLLERS[flown.case.control]


def build_recording(flight: Flight) -> Recording:
    """Return a flight as a recording, marked as simulated."""
    units = {"_s": "s", "_m": "m", "_m_s": "m/s", "_rad": "rad", "_rad_s": "rad/s"}
    units |= {"_Nm": "N m", "_N": "N"}

    def unit(name: str) -> str:
        suffixes = [suffix for suffix in units if name.endswith(suffix)]
        return units[max(suffixes, key=len)] if suffixes else "1"

    finite = np.where(np.isinf(flight.log), np.nan, flight.log)
    case = flight.case
    return Recording(
        tuple(Channel(name, unit(name)) for name in flight.names),
        finite,
        {
            "flight": case.name,
            "rig": case.vehicle.rig.name,
            "gains": case.gains.name,
            "control": flight.user_controller or case.control,
            "environment": case.below.name,
            "z_over_R": f"{case.start_m[2] / case.vehicle.rig.propulsion.radius_m:g}",
            "speed_m_s": f"{case.goals[-1].speed_m_s:g}",
            "gyro_noise_rad_s": f"{case.gyro_noise_rad_s:g}",
            "map_offset_m": ", ".join(f"{value:g}" for value in case.map_offset_m),
            "seed": str(case.seed),
            "ending": flight.ending,
        },
        simulated=True,
    )


def summarize_flight(flown: FlownCase) -> str:
    """Return the result of a flight in one line."""
    measures, goal = flown.measures, flown.case.goals[-1]
    if measures.ending == "struck":
        return f"strikes the obstacle at {flown.flight.end_s:.1f} s"
    if measures.arrives:
        return f"arrives at {measures.arrives_s:.1f} s"
    if measures.swing_m > 0.05:
        return f"never arrives: swings {measures.range_m[0]:.2f} to {measures.range_m[1]:.2f} m"
    return f"stays {abs(goal.x_m - measures.range_m[0]):.2f} m short"


def obstacle_extent(case: FlightCase) -> tuple[float, float] | None:
    """Return the extent of the fixed obstacles along x; None if it is infinite or empty."""
    fixed_blocks = [block for block in case.below.blocks if not any(block.slide_m)]
    ends = [end for block in fixed_blocks for end in block.x_m]
    if not ends or not np.all(np.isfinite(ends)):
        return None
    return min(ends), max(ends)
