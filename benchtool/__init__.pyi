# Written by docs/reference/write_stub.py from benchtool.api and its inputs.
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Literal

from benchtool.acquire.operator import Operator
from benchtool.core.choices import Over
from benchtool.core.rig import Rig
from benchtool.core.user_code import CodePermit
from benchtool.data.catalogue.query import RunSelection
from benchtool.explain.result import Explanation
from benchtool.fit.motor.constants import MotorFit
from benchtool.physics.effects.effect import Effect
from benchtool.physics.model import Model
from benchtool.report.compare.page import RunComparison
from benchtool.report.compare.pooled import PooledFits
from benchtool.report.figure import look as figure_style
from benchtool.report.fit.result import Fit
from benchtool.report.flight.pitch_study import PitchStudy
from benchtool.report.replay.replay_source import ReplaySource
from benchtool.report.result import Data, Result
from benchtool.report.sweep.run import SweepRun
from benchtool.simulate.controllers.controller import Controllers
from benchtool.simulate.flight.study import FlownCase
from benchtool.simulate.flight.study import fly_and_measure as fly

__all__ = [
    "Effect",
    "Model",
    "Result",
    "Rig",
    "__version__",
    "compare",
    "explain",
    "export",
    "figure_style",
    "fit",
    "fly",
    "load_model",
    "load_rig",
    "motor",
    "pool",
    "read",
    "record",
    "runs",
    "simulate_flight",
    "simulate_pitch",
    "sweep",
]
__version__: str

class CallablePackage(ModuleType): ...

def compare(
    data: Data | Sequence[Data],
    *,
    over: Over = "thrust",
    at_thrust_N: float | None = None,
) -> Result[RunComparison]:
    """Compare runs and recordings, like `benchtool report --over --at-thrust`."""

def explain(
    learn: Data | Sequence[Data],
    check: Data | Sequence[Data],
    model: str | Path,
    *,
    permit: CodePermit = ...,
    rig: str | None = None,  # Rig of a CSV file: name or path.
    out: str | Path | None = None,  # Folder for report, figures, new model or next experiment.
    json: str | Path | None = None,  # JSON file for the answer.
    effects: str | None = None,  # Python file or module with user-defined effects.
    seed: int = 0,  # Random seed. [0 or more]
    draws: int = 128,  # Noise draws for the noise floor. [20 to 100,000]
    bootstrap: int = 0,  # Bootstrap draws for p-values; 0: asymptotic. [0 or more]
    overwrite: bool = False,  # Replace existing files.
) -> Result[Explanation]:
    """Identify effects that a model lacks, like `benchtool explain`."""

def export(
    model: Data,
    to: str,
    out: str | Path | None = None,
    *,
    motor: Data | Sequence[Data] = (),
    mass_kg: float | None = None,
    rotors: int | None = None,
    extrapolate: bool = False,
    propeller: str | Path | None = None,
    rig: Rig | str | Path | None = None,
    permit: CodePermit = ...,
) -> tuple[Path, ...]:
    """Write a model for a simulator, autopilot or firmware."""

def fit(
    data: Data | Sequence[Data] = (),
    model: str | Path | None = None,
    *,
    rpm: str | float = "",
    runs: Literal["", "none"] = "",
    permit: CodePermit = ...,
    recipe: str | Path | None = None,  # Folder with a recipe.toml to run.
    rig: str | None = None,  # Rig of a CSV file: name or path.
    calibration: str | None = None,  # Calibration file of a CSV file.
    columns: str | None = None,  # Column map (TOML): channel = column, unit, sign.
    where: str | Sequence[str] = (),  # Keep only rows with COLUMN=VALUE.
    # Fitted quantity: thrust (joint), or T_IGE/T_OGE at equal ...
    basis: Literal["joint", "equal_rpm2", "equal_pwm", "equal_power"] = "joint",
    # Estimator to run.
    method: Literal["least_squares", "emcee"] | Sequence[Literal["least_squares", "emcee"]] = ("least_squares",),
    free: str | Sequence[str] = (),  # Parameter to fit in addition.
    fix: Mapping[str, float] | Sequence[str] = {},  # Fix NAME=VALUE, or NAME at the model value.
    hold: str | Sequence[str] = (),  # Fix a parameter at the model value.
    # Error model: stated, scaled, or with added scatter.
    noise: Literal["auto", "stated", "scale", "add"] = "auto",
    # Loss function; soft_l1 and huber are robust to outliers.
    loss: Literal["linear", "soft_l1", "huber"] = "linear",
    min_z_over_r: float | str | None = None,  # Minimum z/R of points. [0 or more]
    compare: str | Sequence[str] = (),  # Model to compare with, or laws for all laws.
    walkers: int = 32,  # Walkers of each emcee ensemble. [8 or more]
    max_steps: int = 20000,  # Maximum emcee steps per walker. [100 or more]
    seed: int = 1,  # Random seed. [0 or more]
    temperature: float | str | None = None,  # Air temperature. [-40 to 60 degC]
    # Local air pressure, not reduced to sea level. [500 to 1,100 hPa]
    pressure: float | str | None = None,
    humidity: float | str | None = None,  # Relative humidity. [0 to 100 percent]
    profile: bool = False,  # Add profile-likelihood intervals.
    # Uncertainty budget: propagation, or with Monte Carlo check (mc).
    budget: Literal["propagation", "mc"] = "propagation",
    out: str | Path | None = None,  # Folder for result.json, figures and report.html.
    z: str = "",  # Column of the plate distance; none without a plate.
    thrust: str = "",  # Column of the thrust.
    ratio: str = "",  # Column of T/T_OGE, if there is no thrust.
    unit: str = "",  # Unit of the thrust, if its column name has none: gf.
    z_unit: str = "",  # Unit of the distance, if its column name has none: mm, R.
    error: str = "",  # Column of the error of thrust or ratio, or none.
    # Kind of error: standard deviation (sd) or standard error (se).
    error_is: Literal["sd", "se"] | None = None,
    reference: str = "",  # COLUMN=VALUE of the rows out of ground effect.
    radius: float | str | None = None,  # Rotor radius: 0.1016 or 4in. [above 0, at most 100 m]
) -> Fit:
    """Fit a ground-effect model to runs or tables, like `benchtool fit`."""

def load_model(
    model: str | Path,
    permit: CodePermit = ...,
) -> Model:
    """Return a model from the library or a model file."""

def load_rig(
    rig: str | Path,
) -> Rig:
    """Return a rig from the library or a rig file."""

def motor(
    runs: Data | Sequence[Data],
    *,
    mass_kg: float | None = None,
    rotors: int | None = None,
    extrapolate: bool = False,
    propeller: str | Path | None = None,
    rig: Rig | str | Path | None = None,
    out: str | Path | None = None,
) -> Result[MotorFit]:
    """Fit thrust curve and motor constants to runs without a plate, like `benchtool motor`."""

def pool(
    fits: Data | Sequence[Data],
    *,
    of: Sequence[str] = (),
    shared: Sequence[str] = (),
    seed: int = 1,
    out: str | Path | None = None,
) -> Result[PooledFits]:
    """Combine fits of several rigs in a hierarchical model, like `benchtool pool`."""

def read(
    path: Data,
) -> Result[SweepRun] | Result[ReplaySource]:
    """Read a run folder, a recording, a log in an import format, or a table in memory."""

def record(
    bench: str,
    rig: Rig | str | Path | None = None,
    *,
    yes: bool = False,
    operator: Operator | str | None = None,
    permit: CodePermit = ...,
    seconds: float | str = 40.0,  # Duration in bench time. [above 0, at most 3,600 s]
    collective: float | str | None = None,  # Collective pulse width. [above 0, at most 10,000 us]
    plate_z_m: float | str | None = None,  # Plate distance. [above 0, at most 1,000 m]
    limit_deg: float | str = 45.0,  # Pitch angle limit; stops the motors. [above 0, at most 90 deg]
    schedule: str = "",  # Schedule of the device, for the metadata.
    name: str = "pitch",  # Name of the run.
    runs: str | Path = "runs",  # Parent folder of the runs.
    out: str | Path | None = None,  # New run folder.
) -> Result[ReplaySource]:
    """Record a pitch experiment like `benchtool record`, and read the run."""

def runs(
    *folders: str | Path,
    words: str = "",  # Words in name, rig, date, tags, notes.
    # Kind of entry.
    kind: Literal["sweep", "live recording", "pitch recording", "fit", "explanation", "recording", "table", "unknown"] | None = None,
    rig: str = "",  # Rig of a run, model of a fit.
    propeller: str = "",  # Propeller of the rig.
    operator: str = "",  # Operator.
    since: str = "",  # First day, e.g. 2026-03-01.
    until: str = "",  # Last day, e.g. 2026-03-31.
    # Range of z/R, e.g. 0.5,1. [0 or more]
    z_over_r: float | str | Sequence[float | str] | None = None,
    tag: str | Sequence[str] = (),  # Required tags.
    state: str = "",  # State of a run, outcome of a fit or verdict of an explanation.
    # Fitted parameter, optionally with range: body_lift.K_b=1.8..2.1.
    fitted: str | Sequence[str] = (),
) -> RunSelection:
    """Select runs, fits and recordings of folders by their catalogue, as `benchtool runs list`."""

def simulate_flight(
    controllers: Controllers = ("pid", "observer", "feedforward"),
    *,
    permit: CodePermit = ...,
    case: str = "over",  # Case: over, edge, oblique, corner, gust, ramp or plate.
    rig: str = "pquad",  # Rig of the vehicle.
    model: str = "",  # Model of the ground effect, or its file.
    # Height over the obstacle in rotor radii. [above 0, at most 1,000]
    z_over_r: float | str = 2.0,
    speed_m_s: float | str | None = None,  # Speed limit. [0.001 to 50 m/s]
    ramp: bool = False,  # Move the reference, without a speed limit.
    gyro_noise_rad_s: float | str | None = None,  # Gyro noise, standard deviation. [0 to 10 rad/s]
    # Offset X,Y,Z of the feedforward's map; -0.05,0,0. [m]
    map_offset_m: float | str | Sequence[float | str] = (0.0, 0.0, 0.0),
    map: str | Path | None = None,  # Map (TOML or CSV) instead of the obstacle of the case.
    # Goal X,Y instead of that of the case. [m]
    goal_m: float | str | Sequence[float | str] | None = None,
    lag_s: float | str = 0.0,  # Motor time constant. [0 to 10 s]
    layout: Literal["plus", "cross"] = "plus",  # plus, or cross: rotated by 45 degrees.
    # Gain set (s3, s1a, stiff) or its file; several in a campaign.
    gains: str | Sequence[str] = ("s3",),
    duration_s: float | str | None = None,  # Duration. [above 0, at most 3,600 s]
    seed: int = 1,  # Seed of the noise. [0 or more]
    # NAME=VALUE, such as gains.attitude=1.2 (a factor) or gains.attitude.k_q_per_s=8.
    set: Mapping[str, float] | Sequence[str] = {},
    out: str | Path | None = None,  # Folder for recordings, table and figure.
) -> Result[Sequence[FlownCase]]:
    """Simulate flights over an obstacle, like `benchtool simulate flight`."""

def simulate_pitch(
    controllers: Controllers = ("pid", "feedforward", "observer"),
    *,
    permit: CodePermit = ...,
    rig: str | None = None,  # Rig on the hinge.
    model: str = "",  # Model or its file.
    schedule: str = "plate",  # Schedule, or its file.
    # Gain set (s3, s1a, stiff) or its file; several in a campaign.
    gains: str | Sequence[str] = ("s3",),
    duration_s: float | str | None = None,  # Duration. [above 0, at most 3,600 s]
    seed: int = 1,  # Seed of the noise. [0 or more]
    # NAME=VALUE, such as gains.attitude=1.2 (a factor) or gains.attitude.k_q_per_s=8.
    set: Mapping[str, float] | Sequence[str] = {},
    out: str | Path | None = None,  # Folder for recordings, table and figure.
) -> Result[PitchStudy]:
    """Simulate the pitch bench with each controller, like `benchtool simulate pitch`."""

def sweep(
    bench: str = "",
    rig: Rig | str | Path | None = None,
    *,
    yes: bool = False,
    progress: bool = False,
    operator: Operator | str | None = None,
    permit: CodePermit = ...,
    plan: str | Path | None = None,  # Plan file (TOML), or steps, ramp, response, endurance.
    name: str = "sweep",  # Name of the run.
    repeats: int | None = None,  # Points per setting (paper, section 2). [1 to 1,000,000,000]
    sample_s: float | str = 2.0,  # Averaging window of a point. [above 0, at most 3,600 s]
    # Plate distances from the rotor plane: 0.06,0.12,0.24. [above 0, at most 1,000 m]
    z_m: float | str | Sequence[float | str] = (),
    # Plate distances in rotor radii: 0.5,1,2. [above 0, at most 1,000]
    z_over_r: float | str | Sequence[float | str] = (),
    # Plate tilts about the centre; positive: closer to the +x rotors. [-89 to 89 deg]
    tilt: float | str | Sequence[float | str] = (0.0,),
    # Lateral plate positions along x, for partial coverage. [-1,000 to 1,000 m]
    lateral: float | str | Sequence[float | str] = (0.0,),
    # Pulse widths of the active rotors: 1400,1600. [above 0, at most 10,000 us]
    pwm: float | str | Sequence[float | str] = (),
    # Throttle levels in percent of the allowed pulse range: 20,50,80. [above 0, at most 100]
    throttle: float | str | Sequence[float | str] = (),
    rotors: int | Sequence[int] = (),  # Active rotors: 1 or 1,2,3. [1 or more]
    ramp_s: float | str = 0.3,  # Ramp time between throttle levels. [0 to 600 s]
    # Order of the points.
    order: Literal["randomised", "counterbalanced", "as_given"] = "randomised",
    seed: int = 0,  # Seed of the order. [0 or more]
    # Points between repeats of an anchor setting, for drift; 0: none. [0 to 1,000,000]
    anchor_every: int = 20,
    runs: str | Path = "runs",  # Parent folder of the runs.
    out: str | Path | None = None,  # New run folder.
    temperature: float | str | None = None,  # Air temperature. [-40 to 60 degC]
    # Local air pressure, not reduced to sea level. [500 to 1,100 hPa]
    pressure: float | str | None = None,
    humidity: float | str | None = None,  # Relative humidity. [0 to 100 percent]
    calibration: str | None = None,  # Calibration file, or none.
    stage: str | None = None,  # Plate stage: device, hand, grbl:PORT?..., none.
    resume: str | Path | None = None,  # Run folder to resume.
) -> Result[SweepRun]:
    """Sweep plate distance and throttle like `benchtool sweep`, and read the run."""
