"""Records and arrays of the pitch loop.

All numbers of a run are in one block of floats, row by row with adjacent lanes: only then can a
compiler prove that rows do not overlap, and vectorise over lanes. A phase of the loop reads the
records that it needs and writes those that it changes.
"""

from __future__ import annotations

from collections import namedtuple
from typing import Any, NamedTuple

from benchtool.physics.body_lift import BodyImages
from benchtool.physics.expression import Slot
from benchtool.simulate.layout import COUNTS, LINE, PLANE, SOLID

PAST = 64  # longest sensor delay in control ticks; a power of two, see `PAST_MASK`

# State of the body: pitch (positive nose down), rate, random torque, elastic deflection of the dry
# friction as a share (-1 to 1) of its maximum torque; number of plant steps with a disc below the
# validity limit, and at the end stop; acceleration in the last step.
Hinge = namedtuple(
    "Hinge",
    "theta_rad rate_rad_s wake_Nm deflection clamped_steps stopped_steps acceleration_rad_s2",
    defaults=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
)

# True values with the delay of the sensors.
Delayed = namedtuple("Delayed", "theta_rad rate_rad_s plate_z_m", defaults=(0.0, 0.0, 0.0))

# Last readings; speeds per disc.
SensorReadings = namedtuple("SensorReadings", "theta_rad gyro_rad_s plate_z_m speed_rad_s")

# Scheduled attitude (rad), collective (N per rotor), true plate distance with the body level (m),
# and inserted share of the plate (0 to 1).
Setpoint = namedtuple(
    "Setpoint", "reference_rad collective_N plate_z_m plate_share", defaults=(0.0, 0.0, 0.0, 0.0)
)

# Numbers of hinge and rotors: plant step over inertia (s/(kg m2)), weight (N), k (N/(rad/s)2),
# effective radius (m), end stop (rad), and coverage of each disc by the fully inserted plate.
HingedBody = namedtuple("HingedBody", "step_over_inertia weight_N k radius_m stop_rad covered")

# Map from pulse width to speed: slope, and the pulse width at which a rotor starts.
PulseMap = namedtuple("PulseMap", "slope_rad_s_per_us start_us", defaults=(0.0, 0.0))

PulseLimits = namedtuple("PulseLimits", "min_us max_us quantum_us", defaults=(0.0, 0.0, 0.0))

# Standard deviation of one reading, bias and quantum.
SensorErrors = namedtuple("SensorErrors", "noise bias quantum", defaults=(0.0, 0.0, 0.0))

Sensors = namedtuple(  # all sensors of a pitch bench
    "Sensors",
    "theta gyro plate speed",
    defaults=(SensorErrors(), SensorErrors(), SensorErrors(), SensorErrors()),
)

Tick = namedtuple(
    "Tick", "setpoint nominal_plate_z_m nominal_share observer feedforward dither_us pwm_us"
)
"""One column of the schedule.

Attributes:
    nominal_plate_z_m, nominal_share: plate according to the map.
    observer, feedforward: 1 while enabled.
    dither_us: added to the pulse width of discs that push nose down.
    pwm_us: pulse width of each disc, where a log drives the bench.
"""

Fresh = namedtuple("Fresh", "theta gyro plate speed", defaults=(0.0, 0.0, 0.0, 0.0))  # new readings


class PitchArrays(NamedTuple):
    """Arrays of a run.

    Attributes:
        w: records of all lanes, flat: row times lanes plus lane.
        states: random number state of each lane (n_lanes,).
        sent: ring buffer of commanded speeds (n_discs, n_ring, n_lanes).
        past: ring buffer of true pitch, rate and plate distance (3, n_past, n_lanes).
        log: (n_ticks, n_logged, n_lanes), the rows `logged` of `w` at each tick.
        schedule: (n_rows, n_ticks), a `Tick` per column; for a filter `filter_ticks.LoggedTick`.
        fresh: (n_sensors, n_ticks + 1), 1 for a new reading at a tick.
        geometry: a `Geometry` (n_numbers,).
        gains: `filter_ticks.FilterGains` of a filter (n_gains,).
    """

    w: Any = LINE
    states: Any = COUNTS
    sent: Any = SOLID
    past: Any = SOLID
    log: Any = SOLID
    logged: Any = COUNTS
    schedule: Any = PLANE
    fresh: Any = PLANE
    geometry: Any = LINE
    gains: Any = LINE


def tick_slot(n_discs: int) -> Slot:
    """Return the slot of one column of a schedule."""
    return Slot(0, Tick(Setpoint(), 0.0, 0.0, 0.0, 0.0, 0.0, (0.0,) * n_discs))


FRESH = Slot(0, Fresh())


class Geometry(NamedTuple):
    """Plant step; sum of the squared rotor arms; disc positions (n,); root of the number of rotors
    per disc (n,); distances between discs (n, n); sources of the body term (n_body,).
    """

    dt_s: Any
    span_m2: Any
    x_m: Any
    y_m: Any
    roots: Any
    distances_m: Any
    body: BodyImages
