"""The simulated run beside a recording: by its controller where known, else by its pulses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.ndimage import uniform_filter1d

from benchtool.core.array_type import Array
from benchtool.core.errors import InputError
from benchtool.core.plural import pluralize
from benchtool.core.rig import Rig
from benchtool.core.schedule import PARKED_M, SampledSchedule
from benchtool.core.user_code import CodePermit, check_code_allowed
from benchtool.explain.pitch.evidence import PLANT_HZ
from benchtool.explain.pitch.gap import LEAD_S
from benchtool.explain.pitch.log import last_known
from benchtool.explain.pitch.replay_track import PitchTrack, tracking_error
from benchtool.fit.nominal import model_file
from benchtool.physics.model import Model
from benchtool.physics.model_file import load_model
from benchtool.simulate.controllers.laws import pitch_controller
from benchtool.simulate.controllers.pitch import PitchControl
from benchtool.simulate.gain_file import gains_named
from benchtool.simulate.pitch.bench import PitchBench
from benchtool.simulate.pitch.filter_log import LoggedPitch, predict_windows
from benchtool.simulate.pitch.run import PitchJob
from benchtool.simulate.pitch.simulate import simulate_pitch

WINDOW_S = 1.0
"""How long the plant runs free under logged pulses before it starts anew from the readings. Over a
near plate a beam falls away from any prediction within one to two seconds, as in an explanation."""

RATE_SMOOTHING_S = 0.05
"""Width of the mean over readings of the rate where a window begins. A gyro's noise of 0.015 rad/s
would turn a single reading into a drift of most of a degree within a window; wider means lag behind
what the rate does."""

LONGEST_S = 1200.0  # longer recordings are drawn without a simulated run; assumed


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayInputs:
    """Say what stands beside data."""

    model: str = ""  # shipped name, model file, or a folder of fit or explain; empty for none
    rig: str | None = None  # shipped name or file, of data that do not carry theirs
    controller: str = ""  # built-in controller that flew; empty where nobody says
    gains: str = ""  # its gain set; that which the recording names when empty
    plate_z_m: float | None = None  # height over the surface where the recording does not tell it
    motors: tuple[int, ...] = ()  # for each rotor of the rig the number that the recording calls it
    permit: CodePermit = field(default=check_code_allowed, compare=False)

    def refuse_controller(self, why: str) -> None:
        """Refuse options that only a pitch recording has."""
        for option, given in (
            ("--controller", self.controller),
            ("--gains", self.gains),
            ("--plate-z-m", self.plate_z_m is not None),
            ("--motors", self.motors),
        ):
            if given:
                raise InputError(f"{option} is for pitch recordings: {why}; leave it out")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Replay:
    """Hold a simulated run beside a recording; nan where it starts anew.

    Attributes:
        time_s, theta_rad: (m,) of the true attitude.
        pwm_us: (n_rotors, m) what the simulated controller commands; empty when it was driven by
            logged pulses.
        missed: that it does not follow the recording, so that its numbers are no result; empty
            where it does.
    """

    model: str  # its name; rig: that of its rig
    rig: str
    time_s: Array
    theta_rad: Array
    pwm_us: Array
    disturbance_Nm: Array  # (m,) what the simulated observer sees; empty likewise
    words: str  # what drove it, for the caption
    by: str  # "controller" or "pulses"
    missed: str = ""


def controller_of_run(
    provenance: Mapping[str, str], replay_inputs: ReplayInputs
) -> PitchControl | None:
    """Return the controller that flew: as given, else as the recording names it; None if unknown.

    Raises:
        UnknownChoice: a controller or gain set that benchtool has not.
    """
    name, gains = replay_inputs.controller, replay_inputs.gains
    if not name:
        name, gains = provenance.get("controller", ""), gains or provenance.get("gains", "")
        try:
            return pitch_controller(name, gains_named(gains)) if name and gains else None
        except InputError:  # somebody's own controller or gains: not known here
            return None
    if not gains:
        gains = provenance.get("gains", "")
    if not gains:
        raise InputError("--controller needs the gains it flew with; give --gains s3 or a file")
    return pitch_controller(name, gains_named(gains))


def run_replay(
    track: PitchTrack, beside: ReplayInputs, provenance: Mapping[str, str], rig: Rig | None = None
) -> tuple[Replay | None, list[str]]:
    """Return the simulated run, or None with what it lacks; and what a reader must know.

    Args:
        rig: of the recording; None for that of a user's model file.

    Raises:
        InputError: a model whose rig has other rotors than the recording.
    """
    model = load_model(model_file(beside.model), rig, permit=beside.permit).model
    control = controller_of_run(provenance, beside)
    duration_s = len(track) / track.rate_Hz
    if duration_s > LONGEST_S:
        return None, [
            f"The recording is {duration_s:.0f} s long, above {LONGEST_S:.0f} s; cut it for a "
            f"simulated run beside it."
        ]
    plate, problem = _plate(track, beside)
    if problem:
        return None, [problem]
    pulses = _rig_pulses(track, model)
    if pulses is None and control is None:
        return None, ["Neither outputs nor speeds of all rotors stand in the recording, and no "
                      "controller is known, so nothing drives a simulated run."]  # fmt: skip
    bench, remarks = _bench(track, model)
    if control is not None:
        run = _by_controller(track, bench, control, plate, pulses)
    else:
        assert pulses is not None
        run = _by_pulses(track, bench, plate, pulses)
    if beside.motors:
        order = ", ".join(map(str, beside.motors))
        remarks.append(f"Rotors are numbered in the rig's order: these are the log's {order}.")
    if not np.isfinite(run.theta_rad).any():
        return None, ["No stretch of the recording is whole enough for a simulated run."]
    missed = tracking_error(track, run.time_s, run.theta_rad, run.by)
    return replace(run, missed=missed), [*filter(None, [missed]), *remarks]


def _plate(track: PitchTrack, beside: ReplayInputs) -> tuple[Array, str]:
    """Return the plate distance for the simulation (n,), or why it is unknown."""
    over = track.any_over > 0.0
    if not over.any():
        return np.full(len(track), PARKED_M), ""
    if beside.plate_z_m is not None:
        if not 0.0 < beside.plate_z_m < PARKED_M:
            raise InputError(
                f"--plate-z-m is {beside.plate_z_m:g}; give a height above 0 and below "
                f"{PARKED_M:g} m, from where on a plate counts as parked"
            )
        return np.where(over, beside.plate_z_m, PARKED_M), ""
    for heights in (track.plate_z_m, track.distance_m):
        near = over & np.isfinite(heights) & (heights < PARKED_M)
        if near.any():
            rows = np.arange(len(track))
            filled = np.interp(rows, rows[near], heights[near])
            return np.where(over, filled, PARKED_M), ""
    return np.empty(0), (
        "Nothing tells how far below the rotors the surface was, so there is no simulated run; "
        "give --plate-z-m."
    )


def _rig_pulses(track: PitchTrack, model: Model) -> Array | None:
    """Return pulses of the rig's rotors (n_rotors, n), from speeds where there are none."""
    rig, p = model.rig, model.rig.propulsion
    for rows in (track.pwm_us, track.rpm):
        if not len(rows):
            continue
        if len(rows) != rig.n_rotors:
            raise InputError(
                f"the recording has {pluralize(len(rows), 'rotor')}, but rig {rig.name!r} of model "
                f"{model.name} has {rig.n_rotors}; name another model, or the motors with --motors"
            )
        if np.isfinite(rows).any(axis=1).all():
            pulses = rows
            if rows is track.rpm:
                pulses = p.pwm_start_us + rows * np.pi / 30.0 / p.speed_per_us_rad_s
            return np.array([last_known(row) for row in pulses])
    return None


def _bench(track: PitchTrack, model: Model) -> tuple[PitchBench, list[str]]:
    """Return the bench with those discs covered that were over a surface."""
    rig = model.rig
    if not (track.any_over > 0.0).any() or len(track.over) != rig.n_rotors:
        return PitchBench.of(model), []
    covered = np.zeros(rig.n_discs)
    for rotor, row in enumerate(track.over):
        disc = rig.disc_of_rotor[rotor]
        covered[disc] = max(covered[disc], float(row.max()))
    patterns = {tuple(track.rotors_over(first, last)) for first, last in track.visits}
    remarks = []
    if len(patterns) > 1:
        every = ", ".join(str(rotor) for rotor in sorted({r for p in patterns for r in p}))
        remarks.append(
            f"Rotors were over the surface at different times; the simulated run has rotors "
            f"{every} over it in each green stretch."
        )
    return PitchBench.of(model, covered=tuple(covered)), remarks


def _by_controller(
    track: PitchTrack,
    bench: PitchBench,
    control: PitchControl,
    plate_z_m: Array,
    pulses: Array | None,
) -> Replay:
    rate_Hz = control.control_rate_Hz
    ticks = max(2, int(len(track) / track.rate_Hz * rate_Hz))
    at = track.time_s[0] + np.arange(ticks) / rate_Hz
    rows = np.clip(np.round((at - track.time_s[0]) * track.rate_Hz).astype(int), 0, len(track) - 1)
    reference = None
    if np.isfinite(track.reference_rad).any():
        reference = np.nan_to_num(last_known(track.reference_rad))
    ones = np.ones(ticks)
    collective = 1.0  # in thrusts of hover, as it was flown
    if pulses is not None:
        p = bench.model.rig.propulsion
        speed = p.speed_per_us_rad_s * np.maximum(pulses - p.pwm_start_us, 0.0)
        thrust_N = bench.model.parameters["k"].value * speed**2
        collective = float(np.clip(np.median(thrust_N.mean(axis=0)) / bench.hover_N, 0.05, 3.0))
    schedule = SampledSchedule(
        rate_Hz=rate_Hz,
        time_s=np.arange(ticks) / rate_Hz,
        reference_rad=np.zeros(ticks) if reference is None else reference[rows],
        collective=collective * ones,
        dither_us=np.zeros(ticks),
        plate_z_m=plate_z_m[rows],
        plate_share=track.any_over[rows],
        observer=ones,
        feedforward=ones,
    )
    run = simulate_pitch(PitchJob(bench, control), schedule)
    discs = bench.model.rig.disc_of_rotor
    gains = control.gains.name if control.gains is not None else "no"
    given = (
        "the logged reference" if reference is not None else "a level reference (none is logged)"
    )
    return Replay(
        model=bench.model.name,
        rig=bench.model.rig.name,
        time_s=at,
        theta_rad=run.column("true_theta_rad"),
        pwm_us=run.pwm_us[discs],
        disturbance_Nm=run.column("estimate_Nm"),
        words=(
            f"closed loop: controller {control.name} with gains {gains}, given {given} and the "
            f"same surface windows, with noise of its own"
        ),
        by="controller",
    )


def _by_pulses(track: PitchTrack, bench: PitchBench, plate_z_m: Array, pulses: Array) -> Replay:
    """Drive the plant by logged pulses, window by window, each from the readings at its start."""
    rig = bench.model.rig
    substeps = max(1, int(np.ceil(PLANT_HZ / track.rate_Hz)))
    bench = replace(bench, sensors={}, pwm_quantum_us=0.0, plant_rate_Hz=substeps * track.rate_Hz)
    nothing = np.full(len(track), np.nan)
    logged = LoggedPitch(
        rate_Hz=track.rate_Hz,
        pwm_us=pulses[list(rig.first_rotors)],
        plate_z_m=plate_z_m,
        plate_share=track.any_over,
        theta_rad=track.theta_rad,
        gyro_rad_s=track.gyro_rad_s,
        speed_rad_s=np.tile(nothing, (rig.n_discs, 1)),
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
    # The discs' speeds to begin with: as read, else settled at their pulses.
    p, first = rig.propulsion, list(rig.first_rotors)
    speeds = p.speed_per_us_rad_s * np.maximum(logged.pwm_us - p.pwm_start_us, 0.0)
    if len(track.rpm):
        read = track.rpm[first] * np.pi / 30.0
        speeds = np.where(np.isfinite(read), read, speeds)
    states = [
        np.array([[track.theta_rad[row]], [rates[row]], [0.0], [0.0], *speeds[:, row, None]])
        for row in starts
    ]
    theta = nothing.copy()
    lead = round(LEAD_S * track.rate_Hz)
    found = predict_windows([bench], logged, starts, rows, lead, states)
    for start, run in zip(starts, found, strict=True):
        # The last row of a window stays blank: lines break there.
        theta[start : start + rows - 1] = run.theta_rad[:-1, 0]
    return Replay(
        model=bench.model.name,
        rig=rig.name,
        time_s=track.time_s,
        theta_rad=theta,
        pwm_us=np.empty((0, len(track))),
        disturbance_Nm=np.empty(0),
        words=(
            f"open loop: the plant under the logged pulses, begun anew every {WINDOW_S:g} s from "
            f"the readings, because no controller is known"
        ),
        by="pulses",
    )


def provenance_of_run(metadata: Mapping[str, object]) -> dict[str, str]:
    """Return what a recorded run's device says of its controller, as a recording's provenance."""
    device = metadata.get("device")
    facts = device.get("facts", {}) if isinstance(device, dict) else {}
    return {str(key): str(value) for key, value in facts.items()}
