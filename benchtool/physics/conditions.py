"""Conditions of settled measurements: rotor speeds and plate position of each sample."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from benchtool.core.errors import InputError
from benchtool.core.recording import Recording
from benchtool.core.rig import Rig
from benchtool.core.units import Array
from benchtool.physics.effects.effect import HISTORY_TIME_CONSTANTS_S
from benchtool.physics.images import rectangle_coverage
from benchtool.physics.rotor import speed_from_pwm

OUT_OF_GROUND_EFFECT_M = 1e6  # plate distance without a plate; its images vanish to rounding
MIN_MOVE = 5e-4  # m, or rad of tilt; smaller moves are ignored, above a stage's quantum; assumed
MIN_LOAD_CHANGE = 0.01  # of a sum of squared speeds; smaller changes are ignored; assumed


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Conditions:
    """Inputs of a settled prediction, for m samples.

    Attributes:
        speed_rad_s: (n_rotors, m) rotor speeds; 0 for a stopped rotor.
        plate_z_m: (m,) distance from the rotor plane to the plate's centre, along the rotor axis.
        plate_tilt_rad: (m,) commanded tilt about the y axis through the plate's centre; positive
            brings +x rotors nearer.
        coverage: (n_discs, m) fraction of each disc over the plate.
        load_direction: (m,) +1 for a load approached from below, -1 from above, 0 if unknown.
        plate_x_m: (m,) lateral position of the plate's centre.
        airspeed_m_s: (m,) speed of the air along the plate, as in a wind tunnel.
        moved_s: (m,) time since the last plate movement; 0 if unknown.
        moved_direction: (m,) +1 for a plate distance approached from nearer, -1 from farther.
        past_load, past_wash: (4, m) history of load and wake, see `Flow`.
        speed_measured: True for measured speeds; False for speeds from pulse widths, to which
            effects between pulse width and speed apply.
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
    def is_complete(self) -> NDArray[np.bool_]:
        """True for samples with finite speeds, plate position and coverage (m,)."""
        is_complete: NDArray[np.bool_] = (
            np.isfinite(self.speed_rad_s).all(axis=0)
            & np.isfinite(self.coverage).all(axis=0)
            & np.isfinite(self.plate_z_m + self.plate_tilt_rad + self.elapsed_s)
        )
        return is_complete

    def select(self, rows: NDArray[np.bool_] | NDArray[np.intp]) -> Conditions:
        """Return the conditions of the selected samples."""
        names = (field.name for field in fields(self) if field.name != "speed_measured")
        return replace(self, **{name: getattr(self, name)[..., rows] for name in names})

    def with_plate_offset(self, offset_m: float) -> Conditions:
        """Return the conditions with an offset added to the plate distance."""
        return replace(self, plate_z_m=self.plate_z_m + offset_m)

    def out_of_ground_effect(self) -> Conditions:
        """Return the conditions without a plate."""
        return replace(
            self,
            plate_z_m=np.full_like(self.plate_z_m, OUT_OF_GROUND_EFFECT_M),
            plate_tilt_rad=np.zeros_like(self.plate_tilt_rad),
            coverage=np.zeros_like(self.coverage),
        )

    @classmethod
    def build(
        cls,
        rig: Rig,
        *,
        speed_rad_s: Array,
        plate_z_m: Array,
        coverage: Array | None = None,
        speed_measured: bool = True,
        **fields: Array | float | None,
    ) -> Conditions:
        """Build conditions for a rig; all arguments broadcast against plate_z_m (m,).

        Args:
            coverage: default: from the rig's plate and its lateral position.
            fields: other fields; default 0, and the rig's nominal voltage.
        """
        z = np.atleast_1d(np.asarray(plate_z_m, float))
        m = z.shape[0]
        given = {name: value for name, value in fields.items() if value is not None}
        defaults = dict.fromkeys(_ROW_FIELDS, 0.0) | {"voltage_V": rig.propulsion.voltage_nominal_V}
        rows = {name: np.full(m, value, float) for name, value in {**defaults, **given}.items()}
        speed = np.asarray(speed_rad_s, float)
        if speed.ndim == 1:
            speed = speed[:, None]
        if coverage is None:
            coverage = plate_coverage(rig, rows["plate_x_m"])
        return cls(
            speed_rad_s=np.full((rig.n_rotors, m), speed),
            plate_z_m=z,
            coverage=np.full((rig.n_discs, m), coverage),
            past_load=np.zeros((len(HISTORY_TIME_CONSTANTS_S), m)),
            past_wash=np.zeros((len(HISTORY_TIME_CONSTANTS_S), m)),
            speed_measured=speed_measured,
            **rows,
        )

    @classmethod
    def from_recording(cls, recording: Recording, rig: Rig) -> Conditions:
        """Build conditions from the columns of a recording.

        Speeds are from rpm1.., else from pwm1_us.. with the rig's map; a single column applies to
        all rotors. Missing plate columns mean no plate; an empty cell stays nan and a fit excludes
        its row. Without a column load_direction, `load_directions` infers it from the order of the
        points of a run.
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
        conditions = cls.build(
            rig,
            speed_rad_s=_speeds(recording, rig, voltage),
            plate_z_m=z,
            plate_x_m=plate_x,
            plate_tilt_rad=optional("plate_tilt_deg", zeros),
            coverage=coverage,
            voltage_V=voltage,
            elapsed_s=optional("elapsed_s", zeros),
            time_s=optional("time_s", zeros),
            load_direction=np.nan_to_num(optional("load_direction", zeros)),
            airspeed_m_s=np.nan_to_num(optional("airspeed_m_s", zeros)),
            speed_measured="rpm1" in recording,
        )
        if not {"point", "time_s"} <= set(recording.names):
            return conditions
        time, load = conditions.time_s, np.sum(conditions.speed_rad_s**2, axis=0)
        plate_position = np.array([z, plate_x, conditions.plate_tilt_rad])
        if "load_direction" not in recording:
            direction = load_directions(time, conditions.elapsed_s, plate_position, load)
            conditions = replace(conditions, load_direction=direction)
        moved_s, moved_direction = plate_moves(time, plate_position)
        relative_load = np.nan_to_num(load) / max(float(np.nanmax(load, initial=0.0)), 1e-300)
        wake_share = np.mean(coverage, axis=0) / (1.0 + (z / rig.propulsion.radius_m) ** 2)
        return replace(
            conditions,
            moved_s=moved_s,
            moved_direction=moved_direction,
            past_load=past_means(time, moved_s, relative_load),
            past_wash=past_means(time, moved_s, relative_load * np.nan_to_num(wake_share)),
        )


_ROW_FIELDS = (
    "plate_tilt_rad", "voltage_V", "elapsed_s", "time_s", "load_direction", "plate_x_m",
    "airspeed_m_s", "moved_s", "moved_direction",
)  # fmt: skip


def plate_coverage(rig: Rig, plate_x_m: Array) -> Array:
    """Return the covered fraction of each disc (n_discs, m) for a plate centred at x (m,)."""
    half_x, half_y = 0.5 * rig.plate.size_x_m, 0.5 * rig.plate.size_y_m
    x1_m, x2_m, radius_m = plate_x_m - half_x, plate_x_m + half_x, rig.propulsion.radius_m
    return np.array(
        [
            rectangle_coverage(x, y, radius_m, x1_m, x2_m, -half_y, half_y)
            for x, y in rig.disc_positions_m
        ],
        float,
    )


def _speeds(recording: Recording, rig: Rig, voltage_V: Array) -> Array:
    n = rig.n_rotors
    for family, pattern in (("rpm", "rpm{}"), ("pwm", "pwm{}_us")):
        names = [pattern.format(i + 1) for i in range(n)]
        present = [name for name in names if name in recording]
        if not present:
            continue
        if len(present) not in (1, n):
            missing = next(name for name in names if name not in recording)
            raise InputError(
                f"the recording has {len(present)} of {n} {family} columns of rig {rig.name!r}; "
                f"add {missing}, or only {names[0]} for all rotors"
            )
        columns = np.array([recording.to_si(name) for name in present], float)
        if family == "pwm":
            p = rig.propulsion
            columns = np.asarray(
                speed_from_pwm(
                    columns, p.speed_per_us_rad_s, p.pwm_start_us, voltage_V, p.voltage_nominal_V
                )
            )
        return np.full((n, len(recording)), columns)
    raise InputError(
        "the recording has neither rotor speed nor pulse width; map a column to rpm1 or pwm1_us in "
        "the model's [columns] (or a constant: rpm1 = { constant = 6300, unit = 'rpm' })"
    )


def load_directions(time_s: Array, elapsed_s: Array, plate_position: Array, load: Array) -> Array:
    """Return +1 for points approached from a smaller load, -1 from a larger one (m,).

    Motors are stopped while the plate moves and during a tare, so the first point afterwards is
    approached from below. Levels at one plate position follow without a stop. A point with the
    same level as the previous one has the same direction.

    Args:
        time_s: (m,) time since the start of the run, in any order.
        plate_position: (3, m) distance, lateral position (m) and tilt (rad) of the plate.
        load: (m,) sum of squared speeds; 0 with all rotors stopped.
    """
    directions = np.zeros(len(time_s))
    previous = -1
    for row in np.argsort(time_s, kind="stable"):
        if load[row] == 0.0:
            directions[row] = -1.0
        elif (
            previous < 0
            or load[previous] == 0.0
            or elapsed_s[row] < elapsed_s[previous]
            or np.any(np.abs(plate_position[:, row] - plate_position[:, previous]) > MIN_MOVE)
        ):
            directions[row] = 1.0
        elif abs(load[row] - load[previous]) < MIN_LOAD_CHANGE * load[row]:
            directions[row] = directions[previous]
        else:
            directions[row] = np.sign(load[row] - load[previous])
        previous = int(row)
    return directions


def plate_moves(time_s: Array, plate_position: Array) -> tuple[Array, Array]:
    """Return the time since the last plate movement, and its direction, (m,) each.

    The direction is +1 for a distance approached from nearer, -1 from farther. A point without a
    plate position, such as a tare, has that of the previous point. The time of a movement is
    assumed half way between two points.
    """
    since_move_s, directions = np.zeros(len(time_s)), np.zeros(len(time_s))
    order = np.argsort(time_s, kind="stable")
    if not len(order):
        return since_move_s, directions
    move_time_s, direction, previous = time_s[order[0]], 0.0, order[0]
    position = plate_position[:, previous]
    for row in order:
        if np.isfinite(plate_position[:, row]).all():
            change = plate_position[:, row] - position
            if np.any(np.abs(change) > MIN_MOVE):
                move_time_s = 0.5 * (time_s[row] + time_s[previous])
                if abs(change[0]) > MIN_MOVE:
                    direction = float(np.sign(change[0]))
            position = plate_position[:, row]
        since_move_s[row], directions[row], previous = time_s[row] - move_time_s, direction, row
    return since_move_s, directions


def past_means(time_s: Array, moved_s: Array, values: Array) -> Array:
    """Return a quantity (4, m), low-pass filtered with each of `HISTORY_TIME_CONSTANTS_S`.

    The quantity is 0 while the motors are stopped for plate movements; levels at one plate
    position follow without a stop.

    Args:
        time_s: (m,) time since the start of the run, in any order.
        moved_s: (m,) time since the last plate movement.
        values: (m,) quantity of each point; 0 with all rotors stopped.
    """
    time_constants_s = np.array(HISTORY_TIME_CONSTANTS_S)
    means = np.zeros((len(time_constants_s), len(time_s)))
    order = np.argsort(time_s, kind="stable")
    intervals_s = np.diff(time_s[order])[np.diff(moved_s[order]) > 0.0]
    typical_s = float(np.median(intervals_s)) if len(intervals_s) else 0.0
    state = np.zeros(len(time_constants_s))
    previous_s = time_s[order[0]] if len(order) else 0.0
    for row in order:
        interval_s = time_s[row] - previous_s
        running_s = min(interval_s, typical_s)
        state = state * np.exp(-(interval_s - running_s) / time_constants_s)
        state = values[row] + (state - values[row]) * np.exp(-running_s / time_constants_s)
        means[:, row], previous_s = state, time_s[row]
    return means
