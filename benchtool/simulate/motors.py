"""Rotors that follow their commands: a first-order lag and a delay, exact over plant steps."""

from __future__ import annotations

from collections import namedtuple
from typing import Any

import numpy as np

from benchtool.physics.expression import (
    expression,
    inlined_expression,
    read_record,
    with_fields,
    write_record,
)
from benchtool.physics.model import Model

Rotors = namedtuple("Rotors", "speed_rad_s")  # per disc, in flight per rotor: speed (rad/s)

Targets = namedtuple("Targets", "sent_rad_s old_rad_s new_rad_s")
"""Per disc, in flight per rotor: the speed commanded last, and those in force at the beginning
and the end of a plant step (rad/s).
"""

Lag = namedtuple("Lag", "remains old new", defaults=(0.0, 0.0, 0.0))
"""Over half a plant step: what remains of a speed, and the shares of the targets in force at
the step's beginning and end.
"""

Motion = namedtuple(
    "Motion",
    "first second wake_remains wake_kick_Nm delay_steps",
    defaults=(Lag(), Lag(), 0.0, 0.0, 0.0),
)
"""Over a plant step: lag of both halves, what remains of the random torque and what a normal
draw adds (N m), and the delay of commands in whole steps.
"""


@expression
def first_order_lag(lag: Any, speed: Any, old: Any, new: Any) -> Any:
    """Return the speed of each rotor half a plant step on: rad/s."""
    found = speed
    for i in range(len(speed)):
        found = with_fields(found, i, lag.remains * speed[i] + lag.old * old[i] + lag.new * new[i])
    return found


@inlined_expression
def apply_arrived_pulses(
    w: Any, lane: Any, at: Any, sent: Any, step: Any, substeps: Any, to: Any
) -> None:
    """Look up which commands are in force at the two ends of a plant step, after the delay."""
    motion, targets = read_record(w, to.motion, lane, at), read_record(w, to.targets, lane, at)
    late, ring = step - int(motion.delay_steps), sent.shape[1]
    before, after = ((late - 1) // substeps) % ring, (late // substeps) % ring
    old, new = targets.old_rad_s, targets.new_rad_s
    for i in range(len(old)):
        old = with_fields(old, i, sent[i, before, lane])
        new = with_fields(new, i, sent[i, after, lane])
    write_record(w, to.targets, lane, at, Targets(targets.sent_rad_s, old, new))


def motion_of(model: Model, dt_s: float) -> Motion:
    """Return a model's lag, delay and random torque for steps of the plant."""
    tau_s, wait_s = model.lag_s, model.delay_s
    steps = int(np.floor(wait_s / dt_s + 1e-9))
    late_s, half = max(wait_s - steps * dt_s, 0.0), 0.5 * dt_s

    def remains(duration_s: float) -> float:
        """Return the share of the distance to a command that is left after some time."""
        if duration_s <= 0.0:
            return 1.0
        return float(np.exp(-duration_s / tau_s)) if tau_s > 0.0 else 0.0

    def over(old_s: float) -> Lag:
        """Return the lag over half a step, the first `old_s` of it on the command before."""
        before, after = remains(old_s), remains(half - old_s)
        return Lag(before * after, (1.0 - before) * after, 1.0 - after)

    wake_remains = wake_kick = 0.0
    if model.random_torque is not None:
        sd, correlation_s = model.random_torque
        wake_remains = np.exp(-dt_s / correlation_s)
        wake_kick = sd * np.sqrt(1.0 - wake_remains**2)
    first, second = over(min(late_s, half)), over(max(late_s - half, 0.0))
    return Motion(first, second, wake_remains, wake_kick, float(steps))
