"""Where everything stands in the pitch loop's work space: one row per number, one column per lane.

The loop keeps all numbers of a run in one flat array, row after row with the lanes side by side,
because only then can a compiler see that rows do not overlap and run several lanes at once. Blocks
of discs have room for eight.
"""

from __future__ import annotations

from itertools import count

MAX_DISCS = 8

_rows = count()


def _block() -> int:
    """Return the first of eight rows."""
    first = next(_rows)
    for _ in range(MAX_DISCS - 1):
        next(_rows)
    return first


# --- state of the bench -----------------------------------------------------------------------
THETA = next(_rows)  # rad, positive nose down
RATE = next(_rows)  # rad/s
WAKE = next(_rows)  # random torque, N m
SPEED = _block()  # rotor speed per disc, rad/s
TARGET = _block()  # commanded speed per disc, rad/s
OLD = _block()  # target in force at the beginning of a step
NEW = _block()  # target in force at its end
DISC_SPEED = _block()  # root of the summed squares at the middle of a step, rad/s
AREA = _block()  # share of each disc over the plate now
CLAMPED = next(_rows)  # steps with a disc nearer than the formulae hold
STOPPED = next(_rows)  # steps at the end stop

# --- state of sensors and controller ----------------------------------------------------------
SEEN_THETA = next(_rows)  # true values, as late as the sensors show them
SEEN_RATE = next(_rows)
SEEN_PLATE = next(_rows)
READ_THETA = next(_rows)
READ_GYRO = next(_rows)
READ_PLATE = next(_rows)
READ_SPEED = _block()  # rad/s
RATE_INTEGRAL = next(_rows)  # rad/s
ACCELERATION_INTEGRAL = next(_rows)  # rad/s2
EXPLAINED = next(_rows)  # N m s
ERROR_INTEGRAL = next(_rows)  # rad s, of the pulse law
ESTIMATE = next(_rows)  # N m, disturbance as observed
TORQUE = next(_rows)  # N m, asked of the mixer
DIFFERENCE = next(_rows)  # us
FACTOR = _block()  # by which the feedforward divides
PWM = _block()  # us
REFERENCE = next(_rows)  # rad
COLLECTIVE = next(_rows)  # N per rotor
PLATE = next(_rows)  # m, true distance with the beam level
SHARE = next(_rows)  # how far the plate is in, 0 to 1

# --- numbers of the bench ---------------------------------------------------------------------
INERTIA = next(_rows)  # kg m2
WEIGHT = next(_rows)  # N
K = next(_rows)  # N/(rad/s)2 of one rotor
RADIUS = next(_rows)  # m, effective
SLOPE = next(_rows)  # rad/s per us
START = next(_rows)  # us
PWM_MIN = next(_rows)
PWM_MAX = next(_rows)
PWM_QUANTUM = next(_rows)
STOP = next(_rows)  # rad, end stop
COVERED = _block()  # share of each disc over the plate when it is all the way in
WAKE_KEPT = next(_rows)  # exp(-dt / correlation time)
WAKE_KICK = next(_rows)  # N m per normal draw
MID_KEPT = next(_rows)  # lag over the first half of a step: kept, old, new
MID_OLD = next(_rows)
MID_NEW = next(_rows)
END_KEPT = next(_rows)  # lag over the second half
END_OLD = next(_rows)
END_NEW = next(_rows)
DELAY_STEPS = next(_rows)  # whole plant steps of delay

# --- numbers of the sensors: noise, bias, quantum each ----------------------------------------
THETA_SENSOR = (next(_rows), next(_rows), next(_rows))
GYRO_SENSOR = (next(_rows), next(_rows), next(_rows))
PLATE_SENSOR = (next(_rows), next(_rows), next(_rows))
SPEED_SENSOR = (next(_rows), next(_rows), next(_rows))

# --- numbers of the controller ----------------------------------------------------------------
PID = next(_rows)  # the nine fields of control.pid.AttitudePid
for _ in range(8):
    next(_rows)
OBSERVER_RATE = next(_rows)  # 1/s
STRENGTH = next(_rows)  # of the feedforward
PULSE_KP = next(_rows)  # us/rad
PULSE_KI = next(_rows)  # us/(rad s)
PULSE_KD = next(_rows)  # us/(rad/s)
PULSE_LIMIT = next(_rows)  # rad s
BELIEVED_K = next(_rows)
BELIEVED_SLOPE = next(_rows)
BELIEVED_START = next(_rows)
BELIEVED_RADIUS = next(_rows)

EFFECTS = next(_rows)
"""First row of the effects' parameters; those that the controller believes in follow them."""

# --- rows of the schedule, one value per control tick -----------------------------------------
(
    S_REFERENCE,  # rad
    S_COLLECTIVE,  # N per rotor
    S_PLATE,  # m
    S_SHARE,  # 0 to 1
    S_BELIEVED_PLATE,  # m, what a map says
    S_BELIEVED_SHARE,  # 0 to 1
    S_OBSERVER,  # 1 while the observer runs
    S_FEEDFORWARD,  # 1 while the feedforward acts
    S_DITHER,  # us, added to the pulses of the discs that push nose down
) = range(9)
SCHEDULE_ROWS = 9
S_PULSES = 9
"""First of the rows with the pulses of each disc, in us, where a log drives the bench."""

# --- sensors in the order of the flags that say when each has a new reading ---------------------
F_THETA, F_GYRO, F_PLATE, F_SPEED = range(4)
