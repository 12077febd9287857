"""Rotor speed response: first-order lag and delay, exact over plant steps."""

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

# Per disc, in flight per rotor: last commanded speed, and the delayed commands at the beginning and
# the end of a plant step.
Targets = namedtuple("Targets", "sent_rad_s old_rad_s new_rad_s")

# Weights over half a plant step: of the speed before it, and of the delayed commands at beginning
# and end of the step.
Lag = namedtuple("Lag", "remains old new", defaults=(0.0, 0.0, 0.0))

# Over a plant step: lag of both halves, decay factor of the random torque and standard deviation of
# its innovation (N m), and delay of commands in whole steps.
Motion = namedtuple(
    "Motion",
    "first second wake_decay wake_innovation_Nm delay_steps",
    defaults=(Lag(), Lag(), 0.0, 0.0, 0.0),
)


@expression
def first_order_lag(lag: Any, speed: Any, old: Any, new: Any) -> Any:
    """Return the speed of each rotor after half a plant step: rad/s."""
    speeds = speed
    for i in range(len(speed)):
        next_speed = lag.remains * speed[i] + lag.old * old[i] + lag.new * new[i]
        speeds = with_fields(speeds, i, next_speed)
    return speeds


@inlined_expression
def apply_delayed_commands(
    w: Any, lane: Any, lanes: Any, sent: Any, step: Any, substeps: Any, slots: Any
) -> None:
    """Write the delayed commands at beginning and end of a plant step."""
    motion = read_record(w, slots.motion, lane, lanes)
    targets = read_record(w, slots.targets, lane, lanes)
    delayed_step, ring = step - int(motion.delay_steps), sent.shape[1]
    before, after = ((delayed_step - 1) // substeps) % ring, (delayed_step // substeps) % ring
    old, new = targets.old_rad_s, targets.new_rad_s
    for i in range(len(old)):
        old = with_fields(old, i, sent[i, before, lane])
        new = with_fields(new, i, sent[i, after, lane])
    write_record(w, slots.targets, lane, lanes, Targets(targets.sent_rad_s, old, new))


def build_motion(model: Model, dt_s: float) -> Motion:
    """Return lag, delay and random torque of a model for plant steps."""
    tau_s, delay_s = model.lag_s, model.delay_s
    delay_steps = int(np.floor(delay_s / dt_s + 1e-9))
    remaining_delay_s, half_s = max(delay_s - delay_steps * dt_s, 0.0), 0.5 * dt_s

    def decay(duration_s: float) -> float:
        """Return the share of the distance to a command that remains after a duration."""
        if duration_s <= 0.0:
            return 1.0
        return float(np.exp(-duration_s / tau_s)) if tau_s > 0.0 else 0.0

    def half_step_lag(old_s: float) -> Lag:
        """Return the lag over half a step, of which the first `old_s` use the old command."""
        before, after = decay(old_s), decay(half_s - old_s)
        return Lag(before * after, (1.0 - before) * after, 1.0 - after)

    wake_decay = wake_innovation = 0.0
    if model.random_torque is not None:
        sd, correlation_s = model.random_torque
        wake_decay = np.exp(-dt_s / correlation_s)
        wake_innovation = sd * np.sqrt(1.0 - wake_decay**2)
    first = half_step_lag(min(remaining_delay_s, half_s))
    second = half_step_lag(max(remaining_delay_s - half_s, 0.0))
    return Motion(first, second, wake_decay, wake_innovation, float(delay_steps))
