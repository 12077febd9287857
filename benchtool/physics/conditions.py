"""Conditions: what a settled bench was set to and what its rotors did, sample by sample."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array_type import Array
from benchtool.core.errors import InputError
from benchtool.core.recording import Recording
from benchtool.core.rig import Rig
from benchtool.physics.coverage import plate_coverages
from benchtool.physics.effects.effect import PAST_S
from benchtool.physics.rotor import speed_from_pwm

OUT_OF_GROUND_EFFECT_M = (
    1e6  # plate distance that stands for no plate at all; its images vanish to rounding
)


SAME_PLACE = 5e-4  # m, or rad of tilt; a smaller move is none, above a stage's quantum; assumed
SAME_LOAD = 0.01  # share of a summed squared speed; a smaller change is none; assumed


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Conditions:
    """Hold what a settled prediction needs.

    Attributes:
        speed_rad_s: (n_rotors, m) rotor speeds; 0 where a rotor is off.
        plate_z_m: (m,) distance from the rotor plane to the plate's centre, along the rotor axis.
        plate_tilt_rad: (m,) commanded tilt about the y axis through the plate's centre; positive
            brings +x rotors nearer.
        coverage: (n_discs, m) fraction of each disc over the plate.
        load_direction: (m,) +1 where the load was approached from below, -1 from above, 0 where
            nobody knows.
        plate_x_m: (m,) lateral position of the plate's centre.
        airspeed_m_s: (m,) speed of the air along the plate, as in a wind tunnel.
        moved_s: (m,) time since the plate last moved; 0 where nobody knows.
        moved_direction: (m,) +1 where the plate came to its distance from nearer, -1 from farther.
        past_load, past_wash: (4, m) means over the past, see `Flow`.
        speed_measured: whether the speeds were read from the rotors; else they follow from pulse
            widths, and effects between pulse and speed act on them.
    """

    speed_rad_s: Array
    plate_z_m: Array
    plate_tilt_rad: Array
    coverage: Array
    voltage_V: Array
    elapsed_s: Array
    time_s: Array
    load_direction: Array
    plate_x_m: Array
    airspeed_m_s: Array
    moved_s: Array
    moved_direction: Array
    past_load: Array
    past_wash: Array
    speed_measured: bool = True

    def __len__(self) -> int:
        return int(self.plate_z_m.shape[0])

    @property
    def known(self) -> NDArray[np.bool_]:
        """Whether speeds, plate and coverage of each sample are all known (m,)."""
        whole: NDArray[np.bool_] = (
            np.isfinite(self.speed_rad_s).all(axis=0)
            & np.isfinite(self.coverage).all(axis=0)
            & np.isfinite(self.plate_z_m + self.plate_tilt_rad + self.elapsed_s)
        )
        return whole

    def select(self, rows: NDArray[np.bool_] | NDArray[np.intp]) -> Conditions:
        """Return the conditions of only those samples."""
        names = (item.name for item in fields(self) if item.name != "speed_measured")
        return replace(self, **{name: getattr(self, name)[..., rows] for name in names})

    def moved_by(self, farther_m: float) -> Conditions:
        """Return the same conditions with the plate farther away."""
        return replace(self, plate_z_m=self.plate_z_m + farther_m)

    def out_of_ground_effect(self) -> Conditions:
        """Return the same conditions with no plate anywhere."""
        return replace(
            self,
            plate_z_m=np.full_like(self.plate_z_m, OUT_OF_GROUND_EFFECT_M),
            plate_tilt_rad=np.zeros_like(self.plate_tilt_rad),
            coverage=np.zeros_like(self.coverage),
        )

    @classmethod
    def of(
        cls,
        rig: Rig,
        *,
        speed_rad_s: Array,
        plate_z_m: Array,
        plate_x_m: Array | float = 0.0,
        plate_tilt_rad: Array | float = 0.0,
        coverage: Array | None = None,
        voltage_V: Array | float | None = None,
        elapsed_s: Array | float = 0.0,
        time_s: Array | float = 0.0,
        load_direction: Array | float = 0.0,
        airspeed_m_s: Array | float = 0.0,
        speed_measured: bool = True,
    ) -> Conditions:
        """Build conditions for a rig; everything broadcasts against plate_z_m (m,).

        Coverage follows from the rig's plate and its lateral position when it is not given.
        """
        z = np.atleast_1d(np.asarray(plate_z_m, float))
        m = z.shape[0]

        def full(value: Array | float) -> Array:
            return np.broadcast_to(np.asarray(value, float), (m,)).copy()

        speed = np.asarray(speed_rad_s, float)
        if speed.ndim == 1:
            speed = speed[:, None]
        speed = np.broadcast_to(speed, (rig.n_rotors, m)).copy()
        if coverage is None:
            coverage = plate_coverage(rig, full(plate_x_m))
        nominal = rig.propulsion.voltage_nominal_V
        return cls(
            speed_rad_s=speed,
            plate_z_m=z,
            plate_tilt_rad=full(plate_tilt_rad),
            coverage=np.broadcast_to(coverage, (rig.n_discs, m)).copy(),
            voltage_V=full(nominal if voltage_V is None else voltage_V),
            elapsed_s=full(elapsed_s),
            time_s=full(time_s),
            load_direction=full(load_direction),
            plate_x_m=full(plate_x_m),
            airspeed_m_s=full(airspeed_m_s),
            moved_s=np.zeros(m),
            moved_direction=np.zeros(m),
            past_load=np.zeros((len(PAST_S), m)),
            past_wash=np.zeros((len(PAST_S), m)),
            speed_measured=speed_measured,
        )

    @classmethod
    def from_recording(cls, recording: Recording, rig: Rig) -> Conditions:
        """Build conditions from the columns of a recording.

        Uses rpm1.. when it has them, else pwm1_us.. through the rig's map; one speed column stands
        for all rotors. Missing plate columns mean that there is no plate; an empty cell in a
        column that is there stays nan, and its row is for a fit to leave out. Without a column
        load_direction, the order of a run's visits gives it (`load_direction`).
        """
        m = len(recording)
        zeros = np.zeros(m)

        def optional(name: str, default: Array) -> Array:
            return recording.to_si(name) if name in recording else default

        z = optional("plate_z_m", np.full(m, OUT_OF_GROUND_EFFECT_M))
        nominal = np.full(m, rig.propulsion.voltage_nominal_V)
        voltage = optional("voltage_V", nominal)
        voltage = np.where(np.isnan(voltage), nominal, voltage)
        plate_x = optional("plate_x_m", zeros)
        coverage = plate_coverage(rig, plate_x)
        for disc in range(rig.n_discs):
            coverage[disc] = optional(f"coverage{disc + 1}", coverage[disc])
        coverage = np.where(z >= OUT_OF_GROUND_EFFECT_M, 0.0, coverage)
        time = optional("time_s", zeros)
        elapsed = optional("elapsed_s", zeros)
        tilt = optional("plate_tilt_deg", zeros)
        speed = _speeds(recording, rig, voltage)
        found = cls.of(
            rig,
            speed_rad_s=speed,
            plate_z_m=z,
            plate_x_m=plate_x,
            plate_tilt_rad=tilt,
            coverage=coverage,
            voltage_V=voltage,
            elapsed_s=elapsed,
            time_s=time,
            load_direction=np.nan_to_num(optional("load_direction", zeros)),
            airspeed_m_s=np.nan_to_num(optional("airspeed_m_s", zeros)),
            speed_measured="rpm1" in recording,
        )
        if not {"point", "time_s"} <= set(recording.names):
            return found
        place, load = np.array([z, plate_x, tilt]), np.sum(speed**2, axis=0)
        if "load_direction" not in recording:
            found = replace(found, load_direction=load_directions(time, elapsed, place, load))
        moved_s, moved = moves(time, place)
        share = np.nan_to_num(load) / max(float(np.nanmax(load, initial=0.0)), 1e-300)
        meets = np.mean(coverage, axis=0) / (1.0 + (z / rig.propulsion.radius_m) ** 2)
        return replace(
            found,
            moved_s=moved_s,
            moved_direction=moved,
            past_load=past_means(time, moved_s, share),
            past_wash=past_means(time, moved_s, share * np.nan_to_num(meets)),
        )


def plate_coverage(rig: Rig, plate_x_m: Array) -> Array:
    """Return the covered fraction of each disc (n_discs, m) for a plate centred at x (m,)."""
    return plate_coverages(
        rig.disc_positions_m[:, 0],
        rig.disc_positions_m[:, 1],
        rig.propulsion.radius_m,
        (rig.plate.size_x_m, rig.plate.size_y_m),
        plate_x_m,
    )


def _speeds(recording: Recording, rig: Rig, voltage_V: Array) -> Array:
    n = rig.n_rotors
    for family, own in (("rpm", "rpm{}"), ("pwm", "pwm{}_us")):
        names = [own.format(i + 1) for i in range(n)]
        present = [name for name in names if name in recording]
        if not present:
            continue
        if len(present) not in (1, n):
            missing = next(name for name in names if name not in recording)
            raise InputError(
                f"the recording has {len(present)} of {n} {family} columns of rig {rig.name!r}; "
                f"add {missing} (or give {names[0]} alone when all rotors share it)"
            )
        stack = np.array([recording.to_si(name) for name in present], float)
        if family == "pwm":
            p = rig.propulsion
            stack = np.asarray(
                speed_from_pwm(
                    stack, p.speed_per_us_rad_s, p.pwm_start_us, voltage_V, p.voltage_nominal_V
                )
            )
        return np.broadcast_to(stack, (n, len(recording))).copy()
    raise InputError(
        "the recording states neither rotor speed nor pulse width; map a column to rpm1 or pwm1_us "
        "in the model's [columns] (a constant will do: rpm1 = { constant = 6300, unit = 'rpm' })"
    )


def load_directions(time_s: Array, elapsed_s: Array, place: Array, load: Array) -> Array:
    """Return +1 for visits that came from a smaller load, -1 from a greater one (m,).

    Motors stand still while the plate moves, and during a tare, so that the first visit after
    either comes from below; levels at one place follow each other without a stop. A visit that
    repeats the level before it keeps that one's direction.

    Args:
        time_s: (m,) time since the run began; visits may stand in any order.
        place: (3, m) distance, lateral position (m) and tilt (rad) of the plate.
        load: (m,) what thrust goes with: summed squared speeds; 0 with every rotor still.
    """
    directions = np.zeros(len(time_s))
    before = -1
    for here in np.argsort(time_s, kind="stable"):
        if load[here] == 0.0:
            directions[here] = -1.0
        elif (
            before < 0
            or load[before] == 0.0
            or elapsed_s[here] < elapsed_s[before]
            or np.any(np.abs(place[:, here] - place[:, before]) > SAME_PLACE)
        ):
            directions[here] = 1.0
        elif abs(load[here] - load[before]) < SAME_LOAD * load[here]:
            directions[here] = directions[before]
        else:
            directions[here] = np.sign(load[here] - load[before])
        before = int(here)
    return directions


def moves(time_s: Array, place: Array) -> tuple[Array, Array]:
    """Return the time since the plate last moved, and the side that it came from, (m,) each.

    The side is +1 where it came to its distance from nearer, -1 from farther. A visit without a
    known place, as a tare may be, is at that of the one before it. The plate moves between two
    visits; when is not known, and taken to be half way.

    Args:
        time_s: (m,) time since the run began; visits may stand in any order.
        place: (3, m) distance, lateral position (m) and tilt (rad) of the plate.
    """
    since, side = np.zeros(len(time_s)), np.zeros(len(time_s))
    order = np.argsort(time_s, kind="stable")
    if not len(order):
        return since, side
    moved_at_s, direction, before = time_s[order[0]], 0.0, order[0]
    at = place[:, before]
    for here in order:
        if np.isfinite(place[:, here]).all():
            change = place[:, here] - at
            if np.any(np.abs(change) > SAME_PLACE):
                moved_at_s = 0.5 * (time_s[here] + time_s[before])
                if abs(change[0]) > SAME_PLACE:
                    direction = float(np.sign(change[0]))
            at = place[:, here]
        since[here], side[here], before = time_s[here] - moved_at_s, direction, here
    return since, side


def past_means(time_s: Array, moved_s: Array, here: Array) -> Array:
    """Return means over the past (4, m) of what visits have, which forget within `PAST_S`.

    Motors stand still while the plate moves; levels at one place follow each other without a stop.

    Args:
        time_s: (m,) time since the run began; visits may stand in any order.
        moved_s: (m,) time since the plate last moved.
        here: (m,) of each visit; 0 with every rotor still.
    """
    past_s, out = np.array(PAST_S), np.zeros((len(PAST_S), len(time_s)))
    order = np.argsort(time_s, kind="stable")
    stay_s = np.diff(time_s[order])[np.diff(moved_s[order]) > 0.0]
    usual_s = float(np.median(stay_s)) if len(stay_s) else 0.0
    state, before_s = np.zeros(len(PAST_S)), time_s[order[0]] if len(order) else 0.0
    for row in order:
        passed_s = time_s[row] - before_s
        turning_s = min(passed_s, usual_s)
        state = state * np.exp(-(passed_s - turning_s) / past_s)
        state = here[row] + (state - here[row]) * np.exp(-turning_s / past_s)
        out[:, row], before_s = state, time_s[row]
    return out
