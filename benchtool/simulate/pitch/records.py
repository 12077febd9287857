"""What the pitch loop computes with: named records, and where each stands in one flat block.

The loop keeps all numbers of a run in one block of floats, row after row with the lanes side by
side, because only then can a compiler see that rows do not overlap and run several lanes at once.
A phase of the loop reads the records it needs, and writes back those it changed.
"""

from __future__ import annotations

from collections import namedtuple
from functools import lru_cache
from typing import Any, NamedTuple

from benchtool.physics.body_lift import BodyImages
from benchtool.physics.expression import Slot
from benchtool.simulate.layout import COUNTS, LINE, PLANE, SOLID, Layout
from benchtool.simulate.motors import Motion, Rotors, Targets

PAST = 64  # control ticks that delayed sensors may look back; a power of two, see `loops.LAST`

Hinge = namedtuple(
    "Hinge",
    "theta_rad rate_rad_s wake_Nm bent clamped_steps stopped_steps acceleration_rad_s2",
    defaults=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
)
"""The body's state: pitch (rad, positive nose down), its rate, the random torque (N m), and how far
the hinge has yielded, as a share (-1 to 1) of the torque that it holds; plant steps with a disc
nearer than the formulae hold, and steps at the end stop; the last step's acceleration (rad/s2).
"""

Delayed = namedtuple("Delayed", "theta_rad rate_rad_s plate_z_m", defaults=(0.0, 0.0, 0.0))
"""True values as late as the sensors show them: rad, rad/s, m."""

SensorReadings = namedtuple("SensorReadings", "theta_rad gyro_rad_s plate_z_m speed_rad_s")
"""What the sensors showed last: rad, rad/s, m, and rad/s per disc."""

Setpoint = namedtuple(
    "Setpoint", "reference_rad collective_N plate_z_m plate_share", defaults=(0.0, 0.0, 0.0, 0.0)
)
"""What the schedule gives at a tick: attitude (rad), collective (N per rotor), the plate's true
distance with the body level (m), and how far it is in (0 to 1).
"""

Command = namedtuple("Command", "torque_Nm difference_us factor pwm_us")
"""What goes to the motors: torque asked of the mixer (N m), difference of pulses (us); per disc
the factor that the feedforward divides by, and the pulse (us).
"""

HingedBody = namedtuple("HingedBody", "step_over_inertia weight_N k radius_m stop_rad covered")
"""Numbers of hinge and rotors: plant step over inertia (s/(kg m2)), weight (N), k (N/(rad/s)2),
effective radius (m), end stop (rad), and per disc the share over the plate when it is all the way
in.
"""

PulseMap = namedtuple("PulseMap", "slope_rad_s_per_us start_us", defaults=(0.0, 0.0))
"""From pulse width to speed: rad/s per us, and the pulse at which a rotor starts (us)."""

PulseLimits = namedtuple("PulseLimits", "least_us most_us quantum_us", defaults=(0.0, 0.0, 0.0))

SensorErrors = namedtuple("SensorErrors", "noise bias quantum", defaults=(0.0, 0.0, 0.0))
"""Standard deviation of one reading, bias and quantum."""

Sensors = namedtuple(  # all sensors of a pitch bench
    "Sensors",
    "theta gyro plate speed",
    defaults=(SensorErrors(), SensorErrors(), SensorErrors(), SensorErrors()),
)

Nominal = namedtuple("Nominal", "k radius_m pulses strength", defaults=(0.0, 0.0, PulseMap(), 0.0))
"""What mixer and feedforward take for true: k, effective radius, the map of pulses, and how
much of the expected ground effect is compensated.
"""

Tick = namedtuple(
    "Tick", "setpoint nominal_plate_z_m nominal_share observer feedforward dither_us pwm_us"
)
"""One column of the schedule.

Attributes:
    setpoint: what the bench is to do.
    nominal_plate_z_m, nominal_share: the plate as a map has it.
    observer, feedforward: 1 while they act.
    dither_us: added to the pulses of the discs that push nose down.
    pwm_us: of each disc, where a log drives the bench.
"""

Fresh = namedtuple("Fresh", "theta gyro plate speed", defaults=(0.0, 0.0, 0.0, 0.0))  # new readings
PitchPlaces = namedtuple(  # slots of all records in the block of a bench
    "PitchPlaces",
    "hinge rotors targets delayed readings setpoint command law_state body pulses limits motion "
    "sensors nominal law effects nominal_effects nothing",
)


@lru_cache(maxsize=64)
def layout_for(n_discs: int, n_numbers: int, law: Any, law_state: Any) -> Layout:
    """Return the layout for so many discs and effects' numbers; a law's numbers as an example."""
    discs, numbers = (0.0,) * n_discs, (0.0,) * max(n_numbers, 1)
    return Layout(
        PitchPlaces,
        hinge=Hinge(),
        rotors=Rotors(discs),
        targets=Targets(discs, discs, discs),
        delayed=Delayed(),
        readings=SensorReadings(0.0, 0.0, 0.0, discs),
        setpoint=Setpoint(),
        command=Command(0.0, 0.0, discs, discs),
        law_state=law_state,
        body=HingedBody(0.0, 0.0, 0.0, 0.0, 0.0, discs),
        pulses=PulseMap(),
        limits=PulseLimits(),
        motion=Motion(),
        sensors=Sensors(),
        nominal=Nominal(),
        law=law,
        effects=numbers,
        nominal_effects=numbers,
        nothing=0.0,
    )


class PitchArrays(NamedTuple):
    """Hold the arrays of a run.

    Attributes:
        w: records of every lane, flat: row times lanes plus lane (`PitchPlaces`).
        states: state of each lane's random numbers (n_lanes,).
        sent: speeds commanded lately (n_discs, n_ring, n_lanes).
        past: true pitch, rate and plate distance lately (3, n_past, n_lanes), for delayed sensors.
        log: (n_ticks, n_logged, n_lanes), filled with the rows `logged` of each tick.
        schedule: (n_rows, n_ticks), a `Tick` per column; `filter_ticks.LoggedTick` for a filter.
        fresh: (n_sensors, n_ticks + 1) which sensors have a new reading at a tick.
        geometry: a `Geometry` (n_numbers,).
        gains: of a filter, `filter_ticks.FilterGains` (n_gains,).
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
    """Return the slot of one column of a schedule for so many discs."""
    return Slot(0, Tick(Setpoint(), 0.0, 0.0, 0.0, 0.0, 0.0, (0.0,) * n_discs))


FRESH = Slot(0, Fresh())


class Geometry(NamedTuple):
    """Plant step: s. Sum of the rotors' squared arms: m2. Places of the discs (n,): m; root of the
    number of rotors on each (n,); distances between discs (n, n): m; sources of the body term
    (n_body,).
    """

    dt_s: Any
    span_m2: Any
    x_m: Any
    y_m: Any
    roots: Any
    distances_m: Any
    body: BodyImages


def geometry_slot(n_discs: int, n_body: int) -> Slot:
    """Return the slot of a geometry."""
    discs = (0.0,) * n_discs
    body = BodyImages(*((0.0,) * n_body,) * 3)
    return Slot(0, Geometry(0.0, 0.0, discs, discs, discs, (discs,) * n_discs, body))
