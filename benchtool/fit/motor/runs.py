"""Input data of motor fits: throttle points of runs without a plate, and of test stand logs."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from math import pi
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tomli_w
from numpy.typing import NDArray

from benchtool.core.channel import Channel, unit_from_name
from benchtool.core.errors import FileFormatError, InputError
from benchtool.core.recording import Recording
from benchtool.core.rig import UNSPECIFIED, Propeller, Rig
from benchtool.core.rig_file import parse_rig
from benchtool.core.units import Array
from benchtool.data.calibration import zero_covariance, zero_noise
from benchtool.data.columns import speed_columns, word_to_code
from benchtool.data.derived import MeasurementContext, load_run_context
from benchtool.data.levels import read_levels
from benchtool.data.run.read import is_run, read_points, read_samples, run_rig
from benchtool.data.run.run_metadata import read_metadata
from benchtool.fit.motor.law import StepResponse, column_or_nan, step_responses
from benchtool.physics.conditions import Conditions
from benchtool.physics.model_file import load_model

THRUST_ERROR = 0.005  # default standard error, of a thrust and of the highest one; assumed
STANDSTILL_SHARE = 0.02  # a rotor turns above this share of its top speed, else thrust; assumed


@dataclass(frozen=True, slots=True, eq=False)
class ThrottlePoints:
    """Points out of ground effect, each a mean over its samples; all arrays (n,)."""

    time_s: Array
    pulse_us: Array
    way: Array  # 1 after a rise of the throttle, -1 after a decrease, also while held
    thrust_N: Array  # of one rotor, mean over turning rotors
    thrust_se_N: Array
    speed_rad_s: Array  # root mean square over turning rotors
    speed_se_rad_s: Array
    voltage_V: Array
    current_A: Array
    temperature_degC: Array
    run: Array

    @property
    def recording(self) -> Recording:
        """The points as a recording with one column per field."""
        names = type(self).__slots__
        channels = tuple(Channel(name, unit_from_name(name)) for name in names)
        return Recording(channels, np.column_stack([getattr(self, name) for name in names]))

    @property
    def power_W(self) -> Array:
        """Electrical power of all turning rotors (n,): W."""
        return self.voltage_V * self.current_A


def throttle_points(points: Recording, rig: Rig, number: int) -> ThrottlePoints:
    """Return points of one rotor: the mean over turning rotors."""
    pulses = np.stack([points.column(name) for name in speed_columns(points.names, "pwm")])
    on = pulses > rig.propulsion.pwm_stop_us
    turning = np.maximum(on.sum(axis=0), 1)

    def per_rotor(ending: str) -> Array:
        return np.stack(
            [column_or_nan(points, f"rpm{rotor + 1}{ending}") for rotor in range(rig.n_rotors)]
        )

    rad_s = pi / 30.0
    speed = rad_s * np.sqrt(np.where(on, per_rotor("") ** 2, 0.0).sum(axis=0) / turning)
    errors = np.where(on, per_rotor("_se"), 0.0)
    level_us = pulses.max(axis=0)
    return ThrottlePoints(
        time_s=points.column("time_s"),
        pulse_us=level_us,
        way=_way(level_us),
        thrust_N=points.column("thrust_N") / turning,
        thrust_se_N=column_or_nan(points, "thrust_se_N") / turning,
        speed_rad_s=speed,
        speed_se_rad_s=rad_s * np.sqrt((errors**2).sum(axis=0)) / turning,
        voltage_V=column_or_nan(points, "voltage_V"),
        current_A=column_or_nan(points, "current_A"),
        temperature_degC=column_or_nan(points, "temperature_degC"),
        run=np.full(len(points), float(number)),
    )


def _way(level_us: Array) -> Array:
    """Return the sign of each throttle change; without a change, the last sign."""
    change = np.sign(np.diff(level_us, prepend=0.0))
    last = np.maximum.accumulate(np.where(change != 0.0, np.arange(len(change)), 0))
    return np.asarray(change[last], float)


def concatenate_points(parts: Sequence[ThrottlePoints]) -> ThrottlePoints:
    """Return the points of several recordings as one."""
    names = ThrottlePoints.__slots__
    return ThrottlePoints(
        **{name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    )


class MotorData(NamedTuple):
    """Motor data of one run or log."""

    rig: Rig
    points: ThrottlePoints
    steps: tuple[StepResponse, ...]
    zero_N2: Array  # (n, n) covariance of a rotor's thrust due to the load cell's zero error
    scale_sd: float  # relative standard uncertainty of the load cell's scale
    simulated: bool


def read_motor_data(
    paths: Sequence[Path], rig: Rig | None, propeller: Propeller | None
) -> list[MotorData]:
    """Return the data of runs and logs, in their order.

    The rig of logs is the argument, else the rig of a run among the inputs, else built from them.

    Raises:
        FileFormatError: neither a run nor a log, or no point without a plate.
        InputError: logs of several rotors.
    """
    runs = {n: _read_run(path, n) for n, path in enumerate(paths) if is_run(path)}
    logs = {n: _Log.read(path) for n, path in enumerate(paths) if n not in runs}
    if rig is None and runs:
        rig = next(iter(runs.values())).rig
    if rig is None and logs:
        rig = _build_rig(list(logs.values()), propeller)
    log_data = {n: log.data(n, rig) for n, log in logs.items() if rig is not None}
    return [data for _, data in sorted((runs | log_data).items())]


class _Log(NamedTuple):
    """Throttle levels of a test stand log."""

    path: Path
    levels: Recording
    context: MeasurementContext
    turning: NDArray[np.bool_]  # True for levels with a turning rotor

    @classmethod
    def read(cls, path: Path) -> _Log:
        levels, context = read_levels(path)
        missing = [name for name in ("pwm1_us", "thrust_N") if name not in levels]
        if missing:
            raise InputError(
                f"{path} has no {' and no '.join(missing)}, needed for a thrust curve; import it "
                f"again with --columns for these channels"
            )
        if "rpm2" in levels:
            raise InputError(f"{path} is a log of several rotors; give one of a single rotor")
        thrust, speed = levels.column("thrust_N"), column_or_nan(levels, "rpm1")
        signal = np.where(np.isfinite(speed), speed, 0.0)
        signal = signal if signal.any() else thrust
        turning = np.asarray(signal > STANDSTILL_SHARE * np.nanmax(signal), bool)
        if not turning.any() or np.nanmedian(thrust[turning]) <= 0.0:
            raise InputError(
                f"{path} has no positive thrust while the rotor turns; benchtool import {path} "
                f"--flip thrust_N reverses the sign of a pusher mount, --tare thrust_N subtracts "
                f"the load cell reading at standstill"
            )
        return cls(path, levels, context, turning)

    def data(self, number: int, rig: Rig) -> MotorData:
        """Return the levels with a turning rotor; the tare error is from levels at standstill."""
        standstill_N = self.levels.column("thrust_N")[~self.turning]
        zero_error_N = float(np.abs(standstill_N).max()) if standstill_N.size else 0.0
        points = throttle_points(self.levels.select(self.turning), rig, number)
        if not np.isfinite(points.thrust_se_N).any():  # fits of laws inflate it by the scatter
            error_N = THRUST_ERROR * np.hypot(points.thrust_N, points.thrust_N.max())
            points = replace(points, thrust_se_N=error_N)
        zero_N2 = np.full((len(points.run),) * 2, zero_error_N**2)
        scale_sd = _scale_sd(self.context)
        return MotorData(rig, points, (), zero_N2, scale_sd, self.levels.simulated)


def _scale_sd(context: MeasurementContext) -> float:
    """Return the relative standard uncertainty of the load cell's scale."""
    return context.scales["thrust_N"].sd if "thrust_N" in context.scales else 0.0


def _build_rig(logs: Sequence[_Log], propeller: Propeller | None) -> Rig:
    """Return a rig estimated from logs: pulse widths, highest voltage, coefficients.

    Throttle 0 is the pulse width at which the line through the two slowest levels has speed 0.
    """
    first = logs[0].path
    known_values = logs[0].context.known_values
    diameter_m = known_values["diameter_m"].value if "diameter_m" in known_values else None
    diameter_m = diameter_m if propeller is None else propeller.diameter_m
    unknown = {"value": 0.1, "source": f"{UNSPECIFIED}: the log names no propeller"}

    def channel(name: str, turning: bool = True) -> Array:
        return np.concatenate(
            [column_or_nan(g.levels, name)[g.turning if turning else slice(None)] for g in logs]
        )

    pulse, speed = channel("pwm1_us"), channel("rpm1") * np.pi / 30.0
    source = f"the log {', '.join(log.path.name for log in logs)}"
    values: dict[str, Any] = {"source": source, "radius_m": unknown}
    if diameter_m is not None:
        values["radius_m"] = 0.5 * diameter_m
    stop_us = values["pwm_stop_us"] = min(1000.0, float(np.nanmin(channel("pwm1_us", False))))
    values["pwm_max_us"] = float(pulse.max())
    valid = np.isfinite(speed)
    if np.unique(pulse[valid]).size >= 2:
        slope = np.polyfit(pulse[valid], speed[valid], 1)[0]
        low, above = np.unique(pulse[valid])[:2]
        at_low, at_above = (float(speed[valid][pulse[valid] == us].mean()) for us in (low, above))
        zero_us = low - at_low * (above - low) / max(at_above - at_low, 1e-9)
        values["pwm_start_us"] = float(np.clip(zero_us, stop_us, low))
        values["speed_per_us_rad_s"] = float(slope)
        squared = speed[valid] ** 2
        values["thrust_coefficient_N_s2"] = float(np.median(channel("thrust_N")[valid] / squared))
        torque = np.abs(channel("torque_Nm")[valid])
        if np.isfinite(torque).any():
            values["drag_coefficient_Nm_s2"] = float(np.nanmedian(torque / squared))
    voltage = channel("voltage_V", False)
    if np.isfinite(voltage).any():
        values["voltage_nominal_V"] = float(np.nanmax(voltage))
    text = tomli_w.dumps({"name": first.stem, "propulsion": values})
    return parse_rig(text, f"the rig of {first}")


def check_propeller(rig: Rig) -> None:
    """Raise InputError if the propeller of a rig that was built from logs is unknown."""
    if "propulsion.radius_m" in rig.not_stated:
        raise InputError(
            f"the log {rig.name} names no propeller; set --propeller to its size in inches, as "
            f"5x4.5, or its name (benchtool library propellers), or --rig to a rig file"
        )


def _read_run(path: Path, number: int) -> MotorData:
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
    steps: tuple[StepResponse, ...] = ()
    if any((path / f"samples{suffix}").is_file() for suffix in (".csv", ".parquet")):
        steps = step_responses(read_samples(path), rig)
    means = throttle_points(parked, rig, number)
    ratio = _thrust_over_oge(parked, rig)
    means = replace(means, thrust_N=means.thrust_N / ratio, thrust_se_N=means.thrust_se_N / ratio)
    zero_N2 = _zero_covariance(path, parked, rig)
    scale_sd = _scale_sd(load_run_context(path))
    return MotorData(rig, means, steps, zero_N2, scale_sd, points.simulated)


def _thrust_over_oge(points: Recording, rig: Rig) -> Array:
    """Return T_IGE/T_OGE (n,) of eqs. (2) to (4) at the parked plate; 1 at unknown distance."""
    z_m = points.column("plate_z_m")
    model = load_model("quad_body_lift" if rig.n_discs > 1 else "single", rig).model
    conditions = Conditions.build(
        rig,
        speed_rad_s=np.full((rig.n_rotors, len(points)), 100.0),
        plate_z_m=np.where(np.isfinite(z_m), z_m, 1e3),
        plate_x_m=np.zeros(len(points)),
        plate_tilt_rad=np.zeros(len(points)),
    )
    far = conditions.out_of_ground_effect()
    return np.asarray(model.thrust_N(conditions) / model.thrust_N(far), float)


def _zero_covariance(path: Path, points: Recording, rig: Rig) -> Array:
    """Return the covariance (n, n) of a rotor's thrust due to the load cell's zero error: N2.

    The offset of the worst tare is common to a run; zero drift since the tare is added.
    """
    tare_error_N2 = 0.0
    with suppress(FileFormatError):  # the run has no tare points
        tares = read_points(path, ["tare"])
        squared_N2 = tares.column("thrust_N") ** 2 + tares.column("thrust_se_N") ** 2
        tare_error_N2 = float(np.nanmax(squared_N2))
    drift_N2: Array = np.zeros((len(points), len(points)))
    if "elapsed_s" in points:
        time_since_tare_s = np.nan_to_num(points.column("elapsed_s"))
        drift_N2 = zero_covariance(time_since_tare_s, zero_noise(rig))
    pulses = [points.column(name) for name in speed_columns(points.names, "pwm")]
    turning = np.maximum((np.array(pulses) > rig.propulsion.pwm_stop_us).sum(axis=0), 1)
    return (drift_N2 + tare_error_N2) / np.outer(turning, turning)
