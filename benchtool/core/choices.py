"""Named choices and states that several packages use, with their text in files and options.

Help and forms list them in this order.
"""

from __future__ import annotations

from typing import Literal

# Bench
Surface = Literal["below", "above", "beside"]  # plate in the wake, at the inlet, or at the side
PlateMover = Literal["device", "grbl", "hand"]  # the bench itself, a G-code stage, the operator
BenchMode = Literal["plate", "pitch"]  # load cell with plate, or hinged beam with controller
ArmedBy = Literal["operator", "host"]  # of an autopilot's motors
PointKind = Literal["measure", "reference", "anchor"]  # reference and anchor: parked plate
SignalShape = Literal["step", "ramp", "triangle", "chirp", "prbs", "steps"]  # of a schedule

# Uncertainty
EvaluationType = Literal["A", "B"]  # JCGM 100:2008, 3.3: from scatter, otherwise
Distribution = Literal["normal", "uniform", "triangular", "student_t"]  # JCGM 101:2008, 6.4
BudgetMethod = Literal["propagation", "mc"]  # mc: with Monte Carlo check

# Fit
Method = Literal["least_squares", "emcee"]
Loss = Literal["linear", "soft_l1", "huber"]
Status = Literal["converged", "stopped_early", "not_converged"]  # check, do not use the last two

PriorKind = Literal["uniform", "normal"]  # within the bounds, or truncated at the bounds

# Comparison of runs and export
Over = Literal["thrust", "rpm", "power", "throttle", "distance"]  # abscissa
ExportTarget = Literal["all", "sdf", "mujoco", "rotorpy", "ardupilot", "px4", "betaflight", "c"]
