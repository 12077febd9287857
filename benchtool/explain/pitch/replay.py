"""Simulated run of a recording, driven by its controller if known, else by its pulses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.ndimage import uniform_filter1d

from benchtool.core.errors import InputError
from benchtool.core.rig import Rig
from benchtool.core.schedule import PARKED_M, SampledSchedule
from benchtool.core.text import pluralize
from benchtool.core.units import Array
from benchtool.core.user_code import CodePermit, check_code_allowed
from benchtool.explain.pitch.evidence import PLANT_HZ
from benchtool.explain.pitch.log import last_known
from benchtool.explain.pitch.replay_track import PitchTrack, tracking_error
from benchtool.explain.pitch.sanity_checks import bridge_gaps
from benchtool.explain.pitch.subject import LEAD_S
from benchtool.fit.nominal import model_file
from benchtool.physics.model import Model
from benchtool.physics.model_file import load_model
from benchtool.simulate.controllers.laws import build_pitch_controller
from benchtool.simulate.controllers.pitch import PitchControl
from benchtool.simulate.gain_file import load_gains
from benchtool.simulate.pitch.bench import PitchBench
from benchtool.simulate.pitch.filter_log import LoggedPitch, predict_windows
from benchtool.simulate.pitch.run import PitchJob
from benchtool.simulate.pitch.simulate import simulate_pitch

# Open-loop duration before a restart from the readings. Over a near plate a beam diverges from any
# prediction within 1 to 2 s.
WINDOW_S = 1.0

# Width of the mean over rate readings at a restart. Gyro noise of 0.015 rad/s in a single reading
# would cause a drift of nearly 1 deg in a window; wider means lag behind the rate.
RATE_SMOOTHING_S = 0.05

MAX_DURATION_S = 1200.0  # longer recordings get no simulated run; assumed


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayInputs:
    """Inputs of a simulated run for a recording."""

    model: str = ""  # library name, model file, or result folder; empty for none
    rig: str | None = None  # library name or file, for data without a rig
    controller: str = ""  # built-in controller of the flight; empty if unknown
    gains: str = ""  # its gain set; default: from the recording
    plate_z_m: float | None = None  # for recordings without plate distance
    motors: tuple[int, ...] = ()  # motor number in the recording, for each rotor of the rig
    permit: CodePermit = field(default=check_code_allowed, compare=False)

    def check_unused(self, reason: str) -> None:
        """Raise if an option is set that only pitch recordings have."""
        for option, is_set in (
            ("--controller", self.controller),
            ("--gains", self.gains),
            ("--plate-z-m", self.plate_z_m is not None),
            ("--motors", self.motors),
        ):
            if is_set:
                raise InputError(f"{option} is for pitch recordings: {reason}; remove it")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Replay:
    """Simulated run of a recording."""

    model: str  # names of model and rig
    rig: str
    time_s: Array  # (m,)
    theta_rad: Array  # (m,) true attitude; nan at restarts
    pwm_us: Array  # (n_rotors, m) of the simulated controller; empty if driven by logged pulses
    disturbance_Nm: Array  # (m,) of the simulated observer; empty likewise
    description: str  # description of the drive for the caption
    driven_by: str  # "controller" or "pulses"
    warning: str = ""  # that the run does not follow the recording and is no result


def find_controller(provenance: Mapping[str, str], inputs: ReplayInputs) -> PitchControl | None:
    """Return the controller of the run, as given or from the recording; None if unknown.

    Raises:
        UnknownChoice: the given controller or gain set does not exist.
    """
    gains = inputs.gains or provenance.get("gains", "")
    if inputs.controller and not gains:
        raise InputError("--controller needs its gains; give --gains s3 or a file")
    if inputs.controller:
        return build_pitch_controller(inputs.controller, load_gains(gains))
    name = provenance.get("controller", "")
    try:
        return build_pitch_controller(name, load_gains(gains)) if name and gains else None
    except InputError:  # user-defined controller or gains
        return None


def run_replay(
    track: PitchTrack, inputs: ReplayInputs, provenance: Mapping[str, str], rig: Rig | None = None
) -> tuple[Replay | None, list[str]]:
    """Return the simulated run or None, and remarks for the reader.

    Args:
        rig: of the recording; None for that of a user's model file.

    Raises:
        InputError: the rotors of the model's rig differ from those of the recording.
    """
    model = load_model(model_file(inputs.model), rig, permit=inputs.permit).model
    control = find_controller(provenance, inputs)
    duration_s = len(track) / track.rate_Hz
    if duration_s > MAX_DURATION_S:
        limit = f"allowed for a simulated run: {MAX_DURATION_S:.0f} s"
        return None, [f"The recording is {duration_s:.0f} s long; {limit}; shorten it."]
    plate, problem = _estimate_plate(track, inputs)
    if problem:
        return None, [problem]
    pulses = _rig_pulses(track, model)
    if pulses is None and control is None:
        return None, ["A simulated run needs outputs or speeds of all rotors, or a controller."]
    bench, remarks = _bench(track, model)
    if control is not None:
        run = _simulate_controller(track, bench, control, plate, pulses)
    else:
        assert pulses is not None
        run = _simulate_pulses(track, bench, plate, pulses)
    if inputs.motors:
        order = ", ".join(map(str, inputs.motors))
        remarks.append(f"Rotors have the rig's order; their numbers in the log: {order}.")
    if not np.isfinite(run.theta_rad).any():
        return None, ["No window of the recording is complete enough for a simulated run."]
    warning = tracking_error(track, run.time_s, run.theta_rad, run.driven_by)
    return replace(run, warning=warning), [*filter(None, [warning]), *remarks]


def _estimate_plate(track: PitchTrack, inputs: ReplayInputs) -> tuple[Array, str]:
    """Return the plate distance for the simulation (n,), and the problem if it is unknown."""
    is_over = track.max_coverage > 0.0
    if not is_over.any():
        return np.full(len(track), PARKED_M), ""
    if inputs.plate_z_m is not None:
        if not 0.0 < inputs.plate_z_m < PARKED_M:
            raise InputError(
                f"--plate-z-m is {inputs.plate_z_m:g} m; allowed: above 0 and below {PARKED_M:g} m "
                f"(parked plate)"
            )
        return np.where(is_over, inputs.plate_z_m, PARKED_M), ""
    for heights in (track.plate_z_m, track.distance_m):
        has_height = is_over & np.isfinite(heights) & (heights < PARKED_M)
        if has_height.any():
            filled = bridge_gaps(np.where(has_height, heights, np.nan))
            return np.where(is_over, filled, PARKED_M), ""
    return np.empty(0), ("A simulated run needs the distance to the surface; give --plate-z-m.")


def _rig_pulses(track: PitchTrack, model: Model) -> Array | None:
    """Return pulses of the rig's rotors (n_rotors, n), from speeds if not recorded."""
    rig, p = model.rig, model.rig.propulsion
    for series in (track.pwm_us, track.rpm):
        if not len(series):
            continue
        if len(series) != rig.n_rotors:
            raise InputError(
                f"the recording has {pluralize(len(series), 'rotor')}, but rig {rig.name!r} of "
                f"model {model.name} has {rig.n_rotors}; use another model, or select motors with "
                f"--motors"
            )
        if np.isfinite(series).any(axis=1).all():
            pulses = series
            if series is track.rpm:
                pulses = p.pwm_start_us + series * np.pi / 30.0 / p.speed_per_us_rad_s
            return np.array([last_known(values) for values in pulses])
    return None


def _bench(track: PitchTrack, model: Model) -> tuple[PitchBench, list[str]]:
    """Return the bench, with every disc covered that was over a surface in the recording."""
    rig = model.rig
    if not (track.max_coverage > 0.0).any() or len(track.over) != rig.n_rotors:
        return PitchBench.from_model(model), []
    covered = np.zeros(rig.n_discs)
    for rotor, shares in enumerate(track.over):
        disc = rig.disc_of_rotor[rotor]
        covered[disc] = max(covered[disc], float(shares.max()))
    patterns = {tuple(track.rotors_over(first, last)) for first, last in track.visits}
    remarks = []
    if len(patterns) > 1:
        rotors = ", ".join(str(rotor) for rotor in sorted({r for p in patterns for r in p}))
        remarks.append(
            f"Rotors were over the surface at different times; in the simulated run rotors "
            f"{rotors} are over it in each green interval."
        )
    return PitchBench.from_model(model, covered=tuple(covered)), remarks


def _simulate_controller(
    track: PitchTrack,
    bench: PitchBench,
    control: PitchControl,
    plate_z_m: Array,
    pulses: Array | None,
) -> Replay:
    rate_Hz = control.control_rate_Hz
    n_ticks = max(2, int(len(track) / track.rate_Hz * rate_Hz))
    time_s = track.time_s[0] + np.arange(n_ticks) / rate_Hz
    rows = np.round((time_s - track.time_s[0]) * track.rate_Hz).astype(int)
    rows = np.clip(rows, 0, len(track) - 1)
    reference = np.nan_to_num(last_known(track.reference_rad))  # 0 if none is logged
    has_reference = np.isfinite(track.reference_rad).any()
    enabled = np.ones(n_ticks)
    collective = 1.0  # over hover thrust, as in the recording
    if pulses is not None:
        propulsion = bench.model.rig.propulsion
        speed = propulsion.speed_per_us_rad_s * np.maximum(pulses - propulsion.pwm_start_us, 0.0)
        thrust_N = bench.model.parameters["k"].value * speed**2
        collective = float(np.clip(np.median(thrust_N.mean(axis=0)) / bench.hover_N, 0.05, 3.0))
    schedule = SampledSchedule(
        rate_Hz=rate_Hz,
        time_s=np.arange(n_ticks) / rate_Hz,
        reference_rad=reference[rows],
        collective=collective * enabled,
        dither_us=np.zeros(n_ticks),
        plate_z_m=plate_z_m[rows],
        plate_share=track.max_coverage[rows],
        observer=enabled,
        feedforward=enabled,
    )
    run = simulate_pitch(PitchJob(bench, control), schedule)
    discs = bench.model.rig.disc_of_rotor
    gains = control.gains.name if control.gains is not None else "no"
    reference_text = "logged reference" if has_reference else "level (none is logged) reference"
    return Replay(
        model=bench.model.name,
        rig=bench.model.rig.name,
        time_s=time_s,
        theta_rad=run.column("true_theta_rad"),
        pwm_us=run.pwm_us[discs],
        disturbance_Nm=run.column("estimate_Nm"),
        description=(
            f"closed loop: controller {control.name} with gains {gains}, {reference_text} and the "
            f"same surface windows, independent noise"
        ),
        driven_by="controller",
    )


def _simulate_pulses(
    track: PitchTrack, bench: PitchBench, plate_z_m: Array, pulses: Array
) -> Replay:
    """Return a run driven by logged pulses, each window from the readings at its start."""
    rig = bench.model.rig
    substeps = max(1, int(np.ceil(PLANT_HZ / track.rate_Hz)))
    bench = replace(bench, sensors={}, pwm_quantum_us=0.0, plant_rate_Hz=substeps * track.rate_Hz)
    blank = np.full(len(track), np.nan)
    logged = LoggedPitch(
        rate_Hz=track.rate_Hz,
        pwm_us=pulses[list(rig.first_rotors)],
        plate_z_m=plate_z_m,
        plate_share=track.max_coverage,
        theta_rad=track.theta_rad,
        gyro_rad_s=track.gyro_rad_s,
        speed_rad_s=np.tile(blank, (rig.n_discs, 1)),
        mode=np.zeros(len(track)),
        from_speeds=not len(track.pwm_us),
    )
    rows = max(2, round(WINDOW_S * track.rate_Hz))
    rates = track.gyro_rad_s
    if not np.isfinite(rates).any():
        rates = np.gradient(track.theta_rad, 1.0 / track.rate_Hz)
    width = 2 * round(0.5 * RATE_SMOOTHING_S * track.rate_Hz) + 1
    smooth = uniform_filter1d(rates, width, mode="nearest")
    rates = np.where(np.isfinite(smooth), smooth, rates)
    starts = [
        start
        for start in range(0, len(track) - rows + 1, rows)
        if np.isfinite(track.theta_rad[start : start + rows]).all() and np.isfinite(rates[start])
    ]
    # Initial speeds of the discs: measured, else the steady state of their pulses.
    p, first = rig.propulsion, list(rig.first_rotors)
    speeds = p.speed_per_us_rad_s * np.maximum(logged.pwm_us - p.pwm_start_us, 0.0)
    if len(track.rpm):
        measured = track.rpm[first] * np.pi / 30.0
        speeds = np.where(np.isfinite(measured), measured, speeds)
    states = {
        row: np.array([[track.theta_rad[row]], [rates[row]], [0.0], [0.0], *speeds[:, row, None]])
        for row in starts
    }
    theta = blank.copy()
    lead = round(LEAD_S * track.rate_Hz)
    runs = predict_windows([bench], logged, states, rows, lead)
    for start, run in zip(starts, runs, strict=True):
        # The last row of a window stays blank, to break lines.
        theta[start : start + rows - 1] = run.theta_rad[:-1, 0]
    return Replay(
        model=bench.model.name,
        rig=rig.name,
        time_s=track.time_s,
        theta_rad=theta,
        pwm_us=np.empty((0, len(track))),
        disturbance_Nm=np.empty(0),
        description=(
            f"open loop: plant driven by logged pulses, restarted from the readings every "
            f"{WINDOW_S:g} s, because no controller is known"
        ),
        driven_by="pulses",
    )


def read_provenance(metadata: Mapping[str, object]) -> dict[str, str]:
    """Return the device's facts from the metadata of a run, as provenance of a recording."""
    device = metadata.get("device")
    facts = device.get("facts", {}) if isinstance(device, dict) else {}
    return {str(key): str(value) for key, value in facts.items()}
