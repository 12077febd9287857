"""What the pitch loop computes with: named records, and where each stands in one flat block.

The loop keeps all numbers of a run in one block of floats, row after row with the lanes side by
side, because only then can a compiler see that rows do not overlap and run several lanes at once.
A phase of the loop reads the records it needs, and writes back those it changed.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchtool.physics.expression import Slot, numbers_of


class Hinge(NamedTuple):
    """The body's state: pitch (rad, positive nose down), its rate, and the random torque (N m);
    plant steps with a disc nearer than the formulae hold, and steps at the end stop.
    """

    theta_rad: Any = 0.0
    rate_rad_s: Any = 0.0
    wake_Nm: Any = 0.0
    clamped_steps: Any = 0.0
    stopped_steps: Any = 0.0


class Rotors(NamedTuple):
    """Per disc: rotor speed (rad/s)."""

    speed_rad_s: Any


class Targets(NamedTuple):
    """Per disc: the speed commanded last, and those in force at the beginning and the end of a
    plant step (rad/s).
    """

    sent_rad_s: Any
    old_rad_s: Any
    new_rad_s: Any


class Delayed(NamedTuple):
    """True values as late as the sensors show them: rad, rad/s, m."""

    theta_rad: Any = 0.0
    rate_rad_s: Any = 0.0
    plate_z_m: Any = 0.0


class Readings(NamedTuple):
    """What the sensors showed last: rad, rad/s, m, and rad/s per disc."""

    theta_rad: Any
    gyro_rad_s: Any
    plate_z_m: Any
    speed_rad_s: Any


class Setpoint(NamedTuple):
    """What the schedule gives at a tick: attitude (rad), collective (N per rotor), the plate's true
    distance with the body level (m), and how far it is in (0 to 1).
    """

    reference_rad: Any = 0.0
    collective_N: Any = 0.0
    plate_z_m: Any = 0.0
    plate_share: Any = 0.0


class Command(NamedTuple):
    """What goes to the motors: torque asked of the mixer (N m), difference of pulses (us); per disc
    the factor that the feedforward divides by, and the pulse (us).
    """

    torque_Nm: Any
    difference_us: Any
    factor: Any
    pwm_us: Any


class Body(NamedTuple):
    """Numbers of hinge and rotors: inertia (kg m2), weight (N), k (N/(rad/s)2), effective radius
    (m), end stop (rad), and per disc the share over the plate when it is all the way in.
    """

    inertia_kgm2: Any
    weight_N: Any
    k: Any
    radius_m: Any
    stop_rad: Any
    covered: Any


class PulseMap(NamedTuple):
    """From pulse width to speed: rad/s per us, and the pulse at which a rotor starts (us)."""

    slope_rad_s_per_us: Any = 0.0
    start_us: Any = 0.0


class PulseLimits(NamedTuple):
    """What the motors take: us."""

    least_us: Any = 0.0
    most_us: Any = 0.0
    quantum_us: Any = 0.0


class Lag(NamedTuple):
    """Over half a plant step: what remains of a speed, and the shares of the targets in force at
    the step's beginning and end.
    """

    remains: Any = 0.0
    old: Any = 0.0
    new: Any = 0.0


class Motion(NamedTuple):
    """Over a plant step: lag of both halves, what remains of the random torque and what a normal
    draw adds (N m), and the delay of commands in whole steps.
    """

    first: Any = Lag()
    second: Any = Lag()
    wake_remains: Any = 0.0
    wake_kick_Nm: Any = 0.0
    delay_steps: Any = 0.0


class Sensor(NamedTuple):
    """Standard deviation of one reading, bias and quantum."""

    noise: Any = 0.0
    bias: Any = 0.0
    quantum: Any = 0.0


class Sensors(NamedTuple):
    """All sensors of a pitch bench."""

    theta: Any = Sensor()
    gyro: Any = Sensor()
    plate: Any = Sensor()
    speed: Any = Sensor()


class Nominal(NamedTuple):
    """What mixer and feedforward take for true: k, effective radius, the map of pulses, and how
    much of the expected ground effect is compensated.
    """

    k: Any = 0.0
    radius_m: Any = 0.0
    pulses: Any = PulseMap()
    strength: Any = 0.0


class Tick(NamedTuple):
    """One column of the schedule.

    Attributes:
        setpoint: what the bench is to do.
        nominal_plate_z_m, nominal_share: the plate as a map has it.
        observer, feedforward: 1 while they act.
        dither_us: added to the pulses of the discs that push nose down.
        pwm_us: of each disc, where a log drives the bench.
    """

    setpoint: Any
    nominal_plate_z_m: Any
    nominal_share: Any
    observer: Any
    feedforward: Any
    dither_us: Any
    pwm_us: Any


class Fresh(NamedTuple):
    """Which sensors have a new reading at a tick."""

    theta: Any = 0.0
    gyro: Any = 0.0
    plate: Any = 0.0
    speed: Any = 0.0


class Plan(NamedTuple):
    """Integers of a run.

    Attributes:
        substeps: plant steps per tick.
        driver: who controls: `BUILT_IN`, `CALLER`, or `PULSES` of the schedule.
        delayed: whether commands arrive late.
        late_theta, late_rate, late_plate: delays of the sensors in ticks.
    """

    substeps: Any = 1
    driver: Any = 0
    delayed: Any = 0
    late_theta: Any = 0
    late_rate: Any = 0
    late_plate: Any = 0


BUILT_IN, CALLER, PULSES = range(3)


class Places(NamedTuple):
    """Where every record stands in the block of a bench with so many discs and effects."""

    hinge: Slot
    rotors: Slot
    targets: Slot
    delayed: Slot
    readings: Slot
    setpoint: Slot
    command: Slot
    law_state: Slot
    body: Slot
    pulses: Slot
    limits: Slot
    motion: Slot
    sensors: Slot
    nominal: Slot
    law: Slot
    effects: Slot
    nominal_effects: Slot
    nothing: Slot


class Layout:
    """Know where the records of a bench stand: `places` for the loop, rows by name for Python."""

    def __init__(self, n_discs: int, n_numbers: int, law: Any, law_state: Any) -> None:
        self.n_discs, discs, numbers = n_discs, (0.0,) * n_discs, (0.0,) * max(n_numbers, 1)
        self.records = {
            "hinge": Hinge(),
            "rotors": Rotors(discs),
            "targets": Targets(discs, discs, discs),
            "delayed": Delayed(),
            "readings": Readings(0.0, 0.0, 0.0, discs),
            "setpoint": Setpoint(),
            "command": Command(0.0, 0.0, discs, discs),
            "law_state": law_state,
            "body": Body(0.0, 0.0, 0.0, 0.0, 0.0, discs),
            "pulses": PulseMap(),
            "limits": PulseLimits(),
            "motion": Motion(),
            "sensors": Sensors(),
            "nominal": Nominal(),
            "law": law,
            "effects": numbers,
            "nominal_effects": numbers,
            "nothing": 0.0,
        }
        first, slots = 0, {}
        for name, like in self.records.items():
            slots[name] = Slot(first, like)
            first += len(numbers_of(like))
        self.places, self.tick, self.n_rows = Places(**slots), tick_slot(n_discs), first
        self._rows: dict[str, slice] = {}

    def rows(self, path: str) -> slice:
        """Return the rows of a record, or of a field of it, as "hinge.theta_rad"."""
        if path not in self._rows:
            record, _, field = path.partition(".")
            self._rows[path] = rows_in(getattr(self.places, record), field)
        return self._rows[path]

    def column(self, **records: Any) -> NDArray[np.float64]:
        """Return one lane's block (n_rows,) with these records; as at the beginning elsewhere."""
        return np.array(numbers_of(tuple({**self.records, **records}.values())), float)


@lru_cache(maxsize=64)
def layout_for(n_discs: int, n_numbers: int, law: Any, law_state: Any) -> Layout:
    """Return the layout for so many discs and effects' numbers; a law's numbers as an example."""
    return Layout(n_discs, n_numbers, law, law_state)


def zeroed(record: Any) -> Any:
    """Return a record of the same type with zeros for numbers."""
    if not isinstance(record, tuple):
        return 0.0
    parts = [zeroed(part) for part in record]
    return type(record)(*parts) if hasattr(record, "_fields") else tuple(parts)


def rows_in(slot: Slot, path: str) -> slice:
    """Return the rows of a field of a slot's record, as "setpoint.plate_z_m"; of all of it, ""."""
    first, like = slot
    for name in filter(None, path.split(".")):
        k = like._fields.index(name)
        first, like = first + len(numbers_of(like[:k])), like[k]
    return slice(first, first + len(numbers_of(like)))


def tick_slot(n_discs: int) -> Slot:
    """Return the slot of one column of a schedule for so many discs."""
    return Slot(0, Tick(Setpoint(), 0.0, 0.0, 0.0, 0.0, 0.0, (0.0,) * n_discs))


PLAN, FRESH = Slot(0, Plan()), Slot(0, Fresh())


class Geometry(NamedTuple):
    """Plant step: s. Places of the discs (n,): m; root of the number of rotors on each (n,);
    distances between discs (n, n) and from the body's centre (n_arms,): m.
    """

    dt_s: Any
    x_m: Any
    y_m: Any
    roots: Any
    distances_m: Any
    arms_m: Any


def geometry_slot(n_discs: int, n_arms: int) -> Slot:
    """Return the slot of a geometry."""
    discs = (0.0,) * n_discs
    return Slot(0, Geometry(0.0, discs, discs, discs, (discs,) * n_discs, (0.0,) * n_arms))
