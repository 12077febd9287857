"""What motor constants are fitted to: runs without a plate, and logs of thrust stands."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tomli_w
from numpy.typing import NDArray

from benchtool.core.array_type import Array
from benchtool.core.errors import FileFormatError, InputError
from benchtool.core.recording import Recording
from benchtool.core.rig import Propeller, Rig
from benchtool.core.rig_file import parse_rig
from benchtool.data.columns import speed_columns, word_to_code
from benchtool.data.derived import MeasurementContext, run_circumstances
from benchtool.data.levels import read_levels
from benchtool.data.run.read import is_run, read_points, read_samples
from benchtool.data.run.run_metadata import read_metadata
from benchtool.data.run.run_rig import run_rig
from benchtool.data.run.zero_noise import zero_covariance, zero_noise
from benchtool.fit.motor.points import ThrottlePoints, column_of, throttle_points
from benchtool.fit.motor.response import StepResponse, step_responses
from benchtool.physics.conditions import Conditions
from benchtool.physics.model_file import load_model

THRUST_ERROR = 0.005  # of a thrust and of the highest one, where no error is stated; assumed

AT_REST = 0.02  # a rotor stands below this share of its greatest speed, else thrust; assumed


class MotorData(NamedTuple):
    """Hold what one run or log says.

    Attributes:
        zero_N2: covariance of what the load cell's zero puts into a rotor's thrust (n, n).
        scale_sd: relative standard uncertainty of the load cell's scale.
    """

    rig: Rig
    points: ThrottlePoints
    steps: tuple[StepResponse, ...]
    zero_N2: Array
    scale_sd: float
    simulated: bool


def read_motor_data(
    paths: Sequence[Path], rig: Rig | None, propeller: Propeller | None
) -> list[MotorData]:
    """Return what runs and logs say, in their order.

    Logs take the rig that is given, else that of a run among them, else one made from them all.

    Raises:
        FileFormatError: neither a run nor a log, or nothing in it was measured without a plate.
        InputError: logs of an unknown propeller, or of several rotors.
    """
    runs = {n: _of_run(path, n) for n, path in enumerate(paths) if is_run(path)}
    logs = {n: _Log.read(path) for n, path in enumerate(paths) if n not in runs}
    if rig is None and runs:
        rig = next(iter(runs.values())).rig
    if rig is None and logs:
        rig = _rig_of(list(logs.values()), propeller)
    made = {n: log.data(n, rig) for n, log in logs.items() if rig is not None}
    return [one for _, one in sorted((runs | made).items())]


class _Log(NamedTuple):
    """Hold the levels of a stand's log, and which of them turned."""

    path: Path
    levels: Recording
    known: MeasurementContext

    @classmethod
    def read(cls, path: Path) -> _Log:
        levels, known = read_levels(path)
        lacks = [name for name in ("pwm1_us", "thrust_N") if name not in levels]
        if lacks:
            raise InputError(
                f"{path} has no {' and no '.join(lacks)}, and a thrust curve is one over pulses; "
                f"import it again with --columns that name what they are"
            )
        if "rpm2" in levels:
            raise InputError(f"{path} holds several rotors; give a log of one motor and propeller")
        log = cls(path, levels, known)
        if not log.turning.any() or np.nanmedian(levels.column("thrust_N")[log.turning]) <= 0.0:
            raise InputError(
                f"{path} has no positive thrust where the rotor turns; benchtool import {path} "
                f"--flip thrust_N turns the sign of a pusher mount, --tare thrust_N takes off what "
                f"the load cell reads at rest"
            )
        return log

    @property
    def turning(self) -> NDArray[np.bool_]:
        thrust, speed = self.levels.column("thrust_N"), column_of(self.levels, "rpm1")
        moves = np.where(np.isfinite(speed), speed, 0.0)
        if not moves.any():
            moves = thrust
        return np.asarray(moves > AT_REST * np.nanmax(moves), bool)

    def data(self, number: int, rig: Rig) -> MotorData:
        """Return the levels that turned; at rest the load cell shows how well it was tared."""
        turning = self.turning
        rest_N = self.levels.column("thrust_N")[~turning]
        left_N = float(np.abs(rest_N).max()) if rest_N.size else 0.0
        points = throttle_points(self.levels.select(turning), rig, number)
        if not np.isfinite(points.thrust_se_N).any():  # scatter enlarges it where laws are fitted
            error_N = THRUST_ERROR * np.hypot(points.thrust_N, points.thrust_N.max())
            points = replace(points, thrust_se_N=error_N)
        scale = self.known.scales.get("thrust_N")
        return MotorData(
            rig, points, (), np.full((len(points.run),) * 2, left_N**2),
            0.0 if scale is None else scale.sd, self.levels.simulated,
        )  # fmt: skip


def _rig_of(logs: Sequence[_Log], propeller: Propeller | None) -> Rig:
    """Return the rig of logs by what they show: pulses, highest voltage, coefficients.

    Throttle begins where the line through the two slowest levels has no speed.
    """
    first = logs[0].path
    stated = logs[0].known.stated.get("diameter_m")
    diameter_m = stated.value if stated is not None else None
    if propeller is not None:
        diameter_m = propeller.diameter_m
    if diameter_m is None:
        raise InputError(
            f"{first} does not say which propeller turned; name it when the log is imported, or "
            f"add --propeller with its size in inches, as 5x4.5, its name (benchtool library "
            f"propellers), or --rig with a rig file"
        )

    def joined(name: str, turning: bool = True) -> Array:
        return np.concatenate(
            [column_of(log.levels, name)[log.turning if turning else slice(None)] for log in logs]
        )

    pulse, speed = joined("pwm1_us"), joined("rpm1") * np.pi / 30.0
    source = f"the log {', '.join(log.path.name for log in logs)}"
    own: dict[str, Any] = {"source": source, "radius_m": 0.5 * diameter_m}
    stop_us = own["pwm_stop_us"] = min(1000.0, float(np.nanmin(joined("pwm1_us", False))))
    own["pwm_max_us"] = float(pulse.max())
    known = np.isfinite(speed)
    if np.unique(pulse[known]).size >= 2:
        slope = np.polyfit(pulse[known], speed[known], 1)[0]
        low, above = np.unique(pulse[known])[:2]
        at_low, at_above = (float(speed[known][pulse[known] == at].mean()) for at in (low, above))
        zero_us = low - at_low * (above - low) / max(at_above - at_low, 1e-9)
        own["pwm_start_us"] = float(np.clip(zero_us, stop_us, low))
        own["speed_per_us_rad_s"] = float(slope)
        squared = speed[known] ** 2
        own["thrust_coefficient_N_s2"] = float(np.median(joined("thrust_N")[known] / squared))
        torque = np.abs(joined("torque_Nm")[known])
        if np.isfinite(torque).any():
            own["drag_coefficient_Nm_s2"] = float(np.nanmedian(torque / squared))
    voltage = joined("voltage_V", False)
    if np.isfinite(voltage).any():
        own["voltage_nominal_V"] = float(np.nanmax(voltage))
    return parse_rig(tomli_w.dumps({"name": first.stem, "propulsion": own}), f"the rig of {first}")


def _of_run(path: Path, number: int) -> MotorData:
    metadata = read_metadata(path)
    rig = run_rig(path, metadata)
    points = read_points(path)
    parked = points.select(points.column("kind") == word_to_code("kind", "reference"))
    if not len(parked):
        raise FileFormatError(
            str(path), "no point was measured without a plate; sweep with --plan steps"
        )
    suspect = (
        parked.column("suspect") == 1.0 if "suspect" in parked else np.zeros(len(parked), bool)
    )
    if suspect.sum() < 0.5 * len(parked):
        parked = parked.select(~suspect)
    scale = run_circumstances(path).scales.get("thrust_N")
    steps: tuple[StepResponse, ...] = ()
    if any((path / f"samples{suffix}").is_file() for suffix in (".csv", ".parquet")):
        steps = step_responses(read_samples(path), rig)
    scale_sd = 0.0 if scale is None else scale.sd
    own = throttle_points(parked, rig, number)
    far = _over_far(parked, rig)
    own = replace(own, thrust_N=own.thrust_N / far, thrust_se_N=own.thrust_se_N / far)
    zero_N2 = _zero_covariance(path, parked, rig)
    return MotorData(rig, own, steps, zero_N2, scale_sd, points.simulated)


def _over_far(points: Recording, rig: Rig) -> Array:
    """Return thrust over that without a plate (n,), eqs. (2) to (4) at the parked plate's distance.

    1 where no distance is known: the plate is away.
    """
    z_m = points.column("plate_z_m")
    model = load_model("quad_body_lift" if rig.n_discs > 1 else "single", rig).model
    conditions = Conditions.of(
        rig,
        speed_rad_s=np.full((rig.n_rotors, len(points)), 100.0),
        plate_z_m=np.where(np.isfinite(z_m), z_m, 1e3),
        plate_x_m=np.zeros(len(points)),
        plate_tilt_rad=np.zeros(len(points)),
    )
    far = conditions.out_of_ground_effect()
    return np.asarray(model.thrust_N(conditions) / model.thrust_N(far), float)


def _zero_covariance(path: Path, points: Recording, rig: Rig) -> Array:
    """Return the covariance (n, n) of what the load cell's zero puts into a rotor's thrust: N2.

    What the worst tare left is common to a run; from then on the zero wanders.
    """
    tared_N2 = 0.0
    with suppress(FileFormatError):  # none is written
        tares = read_points(path, ["tare"])
        left = tares.column("thrust_N") ** 2 + tares.column("thrust_se_N") ** 2
        tared_N2 = float(np.nanmax(left))
    wander: Array = np.zeros((len(points), len(points)))
    if "elapsed_s" in points:
        since_s = np.nan_to_num(points.column("elapsed_s"))
        wander = zero_covariance(since_s, zero_noise(points, rig))
    pulses = [points.column(name) for name in speed_columns(points.names, "pwm")]
    turning = np.maximum((np.array(pulses) > rig.propulsion.pwm_stop_us).sum(axis=0), 1)
    return (wander + tared_N2) / np.outer(turning, turning)
