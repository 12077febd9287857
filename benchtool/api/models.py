"""Rigs, models, motors, missing effects and exports."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchtool.api.messages import keyword_messages
from benchtool.core.errors import InputError
from benchtool.core.inputs import build_inputs
from benchtool.core.keywords import with_keywords
from benchtool.core.rig import Propeller, Rig
from benchtool.core.rig_file import load_rig_by_name
from benchtool.core.user_code import CodePermit, check_code_allowed
from benchtool.data.columns import rows_to_frame, to_frame
from benchtool.data.propeller_file import load_propeller
from benchtool.explain.inputs import ExplainInputs
from benchtool.explain.result import Explanation
from benchtool.export.targets import write_targets
from benchtool.export.vehicle import build_vehicle
from benchtool.fit.motor.constants import MotorFit, fit_motor
from benchtool.physics.model import Model
from benchtool.physics.model_file import load_model as _load_model
from benchtool.report.answer.folder import check_not_existing, write_json
from benchtool.report.motor import MOTOR, motor_lines
from benchtool.report.result import (
    Data,
    Result,
    estimate_row,
    save_if_requested,
    saved_paths,
)
from benchtool.results import explain_result

NEXT_EXPERIMENTS = (  # inputs of an explanation that need the arming confirmation of a terminal
    *("recordings", "bench", "until", "most_experiments", "most_minutes", "stage", "cluster"),
)


def load_rig(rig: str | Path) -> Rig:
    """Return a rig from the library or a rig file.

    Parameters
    ----------
    rig : str or Path
        Name (`benchtool library rigs`) or path of a rig file.

    Returns
    -------
    Rig
        Frozen dataclass with the tables of a rig file.

    Raises
    ------
    UnknownChoice
        No such name or file.

    Examples
    --------
    >>> import benchtool as bt
    >>> bt.load_rig("pquad").propulsion.radius_m
    0.12
    """
    return load_rig_by_name(rig)


def load_model(model: str | Path, permit: CodePermit = check_code_allowed) -> Model:
    """Return a model from the library or a model file.

    Parameters
    ----------
    model : str or Path
        Name (`benchtool library models`) or path of a model file.
    permit : callable, optional
        Called with a file of user code before it runs; by default this raises.

    Returns
    -------
    Model
        Rig, parameters and effects; `predict(z_over_R)` returns thrust ratios.

    Raises
    ------
    UnknownChoice
        No such name or file.

    Examples
    --------
    >>> import benchtool as bt
    >>> bt.load_model("single").predict(z_over_R=[0.5, 1.0, 4.0]).round(3)
    array([[1.333, 1.067, 1.004]])
    """
    return _load_model(model, permit=permit).model


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
    """Fit thrust curve and motor constants to runs without a plate, like `benchtool motor`.

    Parameters
    ----------
    runs : str, Path, Result, DataFrame, mapping of arrays, or a sequence of these
        Run folders of one rig, including plate sweeps with references, test stand logs, or
        tables with columns `pwm1_us`, `thrust_N` and so on.
    mass_kg : float, optional
        Vehicle mass for the hover point; default: rig value.
    rotors : int, optional
        Number of rotors that carry the mass; default: rig value.
    extrapolate : bool, default False
        Extrapolate thrust to the maximum pulse width and nominal voltage of the rig.
    propeller : str or Path, optional
        Of logs without propeller: name, file, or size in inches.
    rig : Rig, str or Path, optional
        Of logs; default: from the logs.
    out : str or Path, optional
        New HTML file for the report.

    Returns
    -------
    Result
        Tables: `constants` and `points`.

    Raises
    ------
    InputError
        No runs, different rigs, or the mass exceeds the thrust.
    EstimationError
        Too few throttle levels and no throttle step.

    Examples
    --------
    >>> import benchtool as bt
    >>> pwm, rpm = [1200, 1400, 1600, 1800, 2000], [2000, 3500, 5000, 6500, 8000]
    >>> thrust = [1e-7 * value**2 for value in rpm]
    >>> log = {"time_s": range(5), "pwm1_us": pwm, "rpm1": rpm, "thrust_N": thrust}
    >>> constants = bt.motor(log, propeller="10x4.5").to_dataframe()
    >>> constants.set_index("parameter")["value"].round(2)["T_max"].item()
    6.4
    """
    stand = read_stand(rig, propeller)
    result = Result(
        found=fit_motor(saved_paths(runs), mass_kg, *stand, rotors, extrapolate),
        _page=MOTOR, _summary=motor_lines,
        _tables={
            "constants": lambda found: rows_to_frame([estimate_row(e) for e in found.estimates]),
            "points": lambda found: to_frame(found.points.recording),
        },
    )  # fmt: skip
    if out is not None:
        result.report(out)
    return result


@keyword_messages()
@with_keywords(ExplainInputs, omit=NEXT_EXPERIMENTS)
def explain(
    learn: Data | Sequence[Data],
    check: Data | Sequence[Data],
    model: str | Path,
    *,
    permit: CodePermit = check_code_allowed,
    **options: Any,
) -> Result[Explanation]:
    """Identify effects that a model lacks, like `benchtool explain`.

    Parameters
    ----------
    learn : str, Path, Result, DataFrame, mapping of arrays, or a sequence of these
        Training recordings. Columns of a table have channel names, or are mapped by the model.
    check : as `learn`
        Validation recordings of the same bench.
    model : str or Path
        Name or path of a model file.
    permit : callable, optional
        Called with each file of user code before it runs; by default this raises.

    Returns
    -------
    Result
        Tables: `effects`, `gap` and `probabilities`. The verdict is `result.found.kind`,
        as a sentence `result.found.sentence`.

    Raises
    ------
    InputError
        An input is missing or cannot be read.

    Examples
    --------
    >>> import benchtool as bt
    >>> bench, plan = "sim:pquad_single", {"z_over_r": (0.6, 0.8, 1, 1.5, 3, 6), "pwm": 1500,
    ...     "repeats": 2, "sample_s": 0.5, "yes": True}
    >>> learn = bt.sweep(f"{bench}?seed=1", **plan, out="learn")
    >>> check = bt.sweep(f"{bench}?seed=2", **plan, out="check")
    >>> bt.explain(learn, check, "single", draws=20).tables
    ('effects', 'gap', 'probabilities')
    """
    values = {"recordings": saved_paths(learn), "check": saved_paths(check), "model": str(model)}
    inputs = build_inputs(ExplainInputs, values | options)
    if inputs.bench is not None:
        raise InputError(
            "bench needs the command line for the arming confirmation: benchtool explain --bench"
        )
    if not inputs.overwrite:
        check_not_existing(inputs.out, inputs.json)
    result = save_if_requested(explain_result(inputs, permit=permit), inputs.out)
    if inputs.json is not None:
        write_json(inputs.json, result.found, inputs.out)
    return result


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
    permit: CodePermit = check_code_allowed,
) -> tuple[Path, ...]:
    """Write a model for a simulator, autopilot or firmware.

    Parameters
    ----------
    model : str, Path or Result
        Fit folder, run without a plate, test stand log, model file, or model name.
    to : str
        "sdf", "mujoco", "rotorpy", "ardupilot", "px4", "betaflight", "c", or "all".
    out : str or Path, optional
        New file, or new folder for "all"; default: named after the rig.
    motor : str, Path, Result, or a sequence of these, optional
        Runs without a plate or logs; their motor constants replace those of the rig.
    mass_kg, rotors, extrapolate, propeller, rig
        As in `motor`.
    permit : callable, optional
        Called with user code of the model before it runs; by default this raises.

    Returns
    -------
    tuple of Path
        Written files.

    Raises
    ------
    UnknownChoice
        Unknown target or model.
    InputError
        The fit rejected the model.
    WouldOverwrite
        A file exists; nothing was written.

    Examples
    --------
    >>> import benchtool as bt
    >>> [path.name for path in bt.export("quad_body_lift", "mujoco", "rotor.xml")]
    ['rotor.xml']
    """
    (path,) = saved_paths(model)
    stand = read_stand(rig, propeller)
    vehicle = build_vehicle(path, saved_paths(motor), permit, *stand, extrapolate)
    vehicle = replace(vehicle, mass_kg=mass_kg, rotors=rotors)
    return write_targets(vehicle, to, None if out is None else Path(out))


def read_stand(
    rig: Rig | str | Path | None, propeller: str | Path | None
) -> tuple[Rig | None, Propeller | None]:
    """Return rig and propeller of logs."""
    read_rig = load_rig_by_name(rig) if isinstance(rig, str | Path) else rig
    return read_rig, load_propeller(propeller) if propeller else None
