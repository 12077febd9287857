"""Public Python interface: one function per command.

Keyword arguments have the names, ranges, defaults and error messages of the command-line options
(`benchtool fit --help`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchtool.acquire.operator import Operator
from benchtool.acquire.session import run_keywords
from benchtool.core.choices import Over
from benchtool.core.errors import InputError
from benchtool.core.inputs import build_inputs
from benchtool.core.rig import Propeller, Rig
from benchtool.core.rig_file import load_rig_by_name
from benchtool.core.user_code import CodePermit, check_code_allowed
from benchtool.data.catalogue.query import runs
from benchtool.data.columns import concatenate_frames, rows_to_frame, to_frame
from benchtool.data.derived import add_quantities, load_run_context, with_quantities
from benchtool.data.propeller_file import load_propeller
from benchtool.data.run.read import is_run
from benchtool.explain.inputs import ExplainInputs
from benchtool.explain.result import Explanation
from benchtool.export.targets import write_targets
from benchtool.export.vehicle import build_vehicle
from benchtool.fit.motor.constants import MotorFit, fit_motor
from benchtool.fit.recipe import FitInputs, Recipe
from benchtool.fit.run_recipe import FitOutput
from benchtool.physics.effects.effect import Effect
from benchtool.physics.model import Model
from benchtool.physics.model_file import load_model as _load_model
from benchtool.report.answer.folder import check_not_existing, write_json
from benchtool.report.compare import page as comparing
from benchtool.report.compare.pooled import PooledFits
from benchtool.report.figure import look as figure_style
from benchtool.report.flight.pitch_study import PitchStudy
from benchtool.report.motor import MOTOR, motor_lines
from benchtool.report.replay.replay_source import STAND, ReplaySource, read_recorded
from benchtool.report.report_file import detect_kind
from benchtool.report.result import Data, Found, Result, estimate_row, saved_paths
from benchtool.report.sweep.page import SWEEP
from benchtool.report.sweep.run import SweepRun, read_sweep_run
from benchtool.results import explain_result, fit_result, flight_result, pitch_result, pool_result
from benchtool.simulate.controllers.controller import Controllers
from benchtool.simulate.flight.study import FlownCase
from benchtool.simulate.flight.study import fly_and_measure as fly
from benchtool.simulate.inputs import FlightInputs, PitchInputs

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "Effect", "Model", "Result", "Rig", "compare", "explain", "export", "figure_style", "fit",
    "fly", "load_model", "load_rig", "motor", "pool", "read", "record", "runs",
    "simulate_flight", "simulate_pitch", "sweep",
]  # fmt: skip


def load_rig(rig: str | Path) -> Rig:
    """Return a rig by name (`benchtool library rigs`) or path of a rig file."""
    return load_rig_by_name(rig)


def load_model(model: str | Path, permit: CodePermit = check_code_allowed) -> Model:
    """Return a model by name (`benchtool library models`) or path of a model file.

    Args:
        permit: called with a file of user code before it runs; by default this raises.
    """
    return _load_model(model, permit=permit).model


def read(path: str | Path) -> Result[SweepRun] | Result[ReplaySource]:
    """Read a run folder, a recording of `import` or `simulate`, or a log in an import format.

    Tables: `points`, `settings` and `samples` of a sweep; `samples` otherwise.

    Raises:
        FileFormatError: missing path or unknown content.
    """
    path = Path(path)
    if is_run(path) and detect_kind(path) == "sweep":
        return _sweep(path)
    replay = read_recorded(path)
    n_rows = len(replay.recording)
    names = ", ".join(replay.recording.names)
    return Result(
        found=replay, path=path, _page=STAND,
        _summary=lambda source: f"{source.name}: {n_rows} rows of {names}",
        _tables={"samples": lambda source: to_frame(source.with_quantities())},
    )  # fmt: skip


def _sweep(path: Path) -> Result[SweepRun]:
    tables: dict[str, Callable[[SweepRun], pd.DataFrame]] = {
        "points": lambda run: to_frame(add_quantities(run.points, load_run_context(path))),
        "settings": lambda run: to_frame(with_quantities(run.settings, run.quantities)),
    }
    run = read_sweep_run(path)
    if (samples := run.samples) is not None:
        tables["samples"] = lambda run: to_frame(samples)
    return Result(
        found=run, path=path, _page=SWEEP, _summary=lambda run: str(SWEEP.summary(run)),  # type: ignore[operator]
        _tables=tables,
    )  # fmt: skip


def sweep(
    bench: str = "",
    rig: Rig | str | Path | None = None,
    *,
    yes: bool = False,
    operator: Operator | None = None,
    permit: CodePermit = check_code_allowed,
    **options: Any,
) -> Result[SweepRun]:
    """Sweep plate distance and throttle like `benchtool sweep`, and read the run.

    Motors turn. Every exit stops them, including Ctrl-C and *Interrupt* of a notebook; signals
    are handled only if this is called in the main thread, as in notebooks. Tables as in `read`.

    Args:
        bench: address, for example ``"sim:pquad"``; not needed with ``resume=``.
        rig: rig on the bench; default: rig of a ``sim:`` address.
        yes: skip the arming confirmation, for a simulated bench or one whose `benchtool bench
            check` passed today.
        operator: interface for the arming confirmation, in place of `yes`.
        permit: called with user code files in the address; by default this raises.
        options: options of the command by name: ``z_over_r=(0.6, 1, 2)``, ``pwm=(1500, 1600)``,
            ``repeats=3``, ``plan="plan.toml"``, ``out="run"``, ``resume="run"``.

    Raises:
        InputError: no confirmation, or invalid or incomplete inputs; no motor has turned.
        BenchError, RunInterrupted: the sweep ended early; throttle is zero, and the measured points
            are in the run folder.
    """
    values = {"address": bench or None, "yes": yes} | options
    return _sweep(run_keywords("sweep", values, rig, operator, permit))


def record(
    bench: str,
    rig: Rig | str | Path | None = None,
    *,
    yes: bool = False,
    operator: Operator | None = None,
    permit: CodePermit = check_code_allowed,
    **options: Any,
) -> Result[ReplaySource]:
    """Record a pitch experiment like `benchtool record`, and read the run; otherwise as `sweep`."""
    values = {"address": bench, "yes": yes} | options
    return read(run_keywords("record", values, rig, operator, permit))  # type: ignore[return-value]


def motor(
    runs: Data | Sequence[Data],
    *,
    mass_kg: float | None = None,
    rotors: int | None = None,
    extrapolate: bool = False,
    propeller: str | Path | None = None,
    rig: Rig | str | Path | None = None,
) -> Result[MotorFit]:
    """Fit thrust curve and motor constants to runs without a plate, like `benchtool motor`.

    Tables: `constants` and `points`.

    Args:
        runs: run folders of one rig, including plate sweeps with references, or test stand logs.
        mass_kg: vehicle mass for the hover point; default: rig value.
        rotors: number of rotors that carry the mass; default: rig value.
        extrapolate: extrapolate thrust to the maximum pulse width and nominal voltage of the rig.
        propeller: of logs without propeller: name, file, or size in inches.
        rig: of logs; default: from the logs.

    Raises:
        InputError: no runs, different rigs, or the mass exceeds the thrust.
        EstimationError: too few throttle levels and no throttle step.
    """
    return Result(
        found=fit_motor(saved_paths(runs), mass_kg, *_stand(rig, propeller), rotors, extrapolate),
        _page=MOTOR, _summary=motor_lines,
        _tables={
            "constants": lambda found: rows_to_frame([estimate_row(e) for e in found.estimates]),
            "points": lambda found: to_frame(found.points.recording),
        },
    )  # fmt: skip


def fit(
    data: Data | Sequence[Data],
    model: str | Path,
    *,
    permit: CodePermit = check_code_allowed,
    **options: Any,
) -> Result[FitOutput]:
    """Fit a ground-effect model to run folders or CSV files, like `benchtool fit`.

    Tables: `estimates`, `points` and `ratio`. The fitted model is `result.found.fitted`.

    Args:
        data: one or more run folders, CSV files or results.
        model: name or path of a model file.
        permit: called with user code of the model before it runs; by default this raises.
        options: options of the command by name: ``free=("R_m",)``, ``method=("emcee",)``.

    Raises:
        InputError: the data or the model do not allow the fit.
        EstimationError: no estimate is possible.
    """
    paths = saved_paths(data)
    base = Recipe(name=Path(paths[0]).stem, data=paths, model=str(model))
    inputs = build_inputs(FitInputs, options, base=FitInputs(recipe=base))
    return _saved(fit_result(inputs, permit=permit), inputs.out)


def pool(
    fits: Data | Sequence[Data],
    *,
    of: Sequence[str] = (),
    shared: Sequence[str] = (),
    seed: int = 1,
) -> Result[PooledFits]:
    """Combine fits of several rigs in a hierarchical model, like `benchtool pool`.

    Tables: `rigs` and `differences`. Posterior draws are in `result.found.pooled`.

    Args:
        fits: folders of `benchtool fit --out`, one per rig.
        of: parameters that may differ between rigs; default: all without a unit.
        shared: parameters that are equal in all rigs.
        seed: random seed.

    Raises:
        InputError: fewer than two fits, failed fits, or fits with common data.
        NotConverged: the chains have not converged.
    """
    return pool_result([Path(path) for path in saved_paths(fits)], of, shared, seed)


def compare(
    data: Data | Sequence[Data], *, over: Over = "thrust", at_thrust_N: float | None = None
) -> Result[comparing.RunComparison]:
    """Compare runs and recordings, like `benchtool report --over --at-thrust`.

    Tables: `curves`, and with `at_thrust_N` also `best`, most efficient first.

    Args:
        data: one or more run folders or recordings of `benchtool import`.
        over: abscissa of the figure.
        at_thrust_N: thrust at which the runs are ranked.

    Raises:
        InputError: no run contains the abscissa.
    """
    comparison = comparing.compare_runs(
        [Path(path) for path in saved_paths(data)], over, at_thrust_N
    )
    tables: dict[str, Callable[[comparing.RunComparison], pd.DataFrame]] = {
        "best": lambda comparison: rows_to_frame(comparing.best_rows(comparison)),
        "curves": lambda comparison: concatenate_frames(comparison.tables()),
    }
    if not comparison.found:
        del tables["best"]
    page, summary = comparing.COMPARISON, comparing.comparison_sentence
    return Result(found=comparison, _page=page, _summary=summary, _tables=tables)


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
    """Write a model for a simulator, autopilot or firmware; return the written files.

    Args:
        model: fit folder, run without a plate, test stand log, model file, or model name.
        to: "sdf", "mujoco", "rotorpy", "ardupilot", "px4", "betaflight", "c", or "all".
        out: new file, or new folder for "all"; default: named after the rig.
        motor: runs without a plate or logs; their motor constants replace those of the rig.
        mass_kg: vehicle mass for the hover point; default: rig value.
        rotors: number of rotors that carry the mass; default: rig value.
        extrapolate: as in `motor`.
        propeller: of logs, as in `motor`.
        rig: of logs, as in `motor`.
        permit: called with user code of the model before it runs; by default this raises.

    Raises:
        UnknownChoice: unknown target or model.
        InputError: the fit rejected the model.
        WouldOverwrite: a file exists; nothing was written.
    """
    (path,) = saved_paths(model)
    vehicle = build_vehicle(path, saved_paths(motor), permit, *_stand(rig, propeller), extrapolate)
    vehicle = replace(vehicle, mass_kg=mass_kg, rotors=rotors)
    return write_targets(vehicle, to, None if out is None else Path(out))


def _stand(
    rig: Rig | str | Path | None, propeller: str | Path | None
) -> tuple[Rig | None, Propeller | None]:
    """Return rig and propeller of logs."""
    read_rig = load_rig_by_name(rig) if isinstance(rig, str | Path) else rig
    return read_rig, load_propeller(propeller) if propeller else None


def explain(
    learn: Data | Sequence[Data],
    check: Data | Sequence[Data],
    model: str | Path,
    *,
    permit: CodePermit = check_code_allowed,
    **options: Any,
) -> Result[Explanation]:
    """Identify effects that a model lacks, like `benchtool explain`.

    Tables: `effects`, `gap` and `probabilities`. The verdict is `result.found.verdict`.

    Args:
        learn: training recordings.
        check: validation recordings of the same bench.
        model: name or path of a model file.
        permit: called with each file of user code before it runs; by default this raises.
        options: options of the command by name: ``effects="mine.py"``, ``rig="own.toml"`` (of CSV
            files only), ``seed=3``, ``draws=500``, ``out="found"``.

    Raises:
        InputError: an input is missing or cannot be read.
    """
    values = {"recordings": saved_paths(learn), "check": saved_paths(check), "model": str(model)}
    inputs = build_inputs(ExplainInputs, values | options)
    if inputs.bench is not None:
        raise InputError(
            "bench needs the command line for the arming confirmation: benchtool explain --bench"
        )
    check_not_existing(inputs.out, inputs.json)
    result = _saved(explain_result(inputs, permit=permit), inputs.out)
    if inputs.json is not None:
        write_json(inputs.json, result.found, inputs.out)
    return result


def simulate_pitch(
    controllers: Controllers = ("pid", "feedforward", "observer"),
    *,
    permit: CodePermit = check_code_allowed,
    **options: Any,
) -> Result[PitchStudy]:
    """Simulate the pitch bench with each controller, like `benchtool simulate pitch`.

    Tables: one per controller, and `visits` of the plate.

    Args:
        controllers: built-in names and user classes.
        permit: called with user code of the model before it runs; by default this raises.
        options: options of the command by name: ``schedule="plate"``, ``set={"body_lift.K_b": 2}``.
    """
    inputs = build_inputs(PitchInputs, options)
    return _saved(pitch_result(inputs, controllers, permit), inputs.study.out)


def simulate_flight(
    controllers: Controllers = ("pid", "observer", "feedforward"),
    *,
    permit: CodePermit = check_code_allowed,
    **options: Any,
) -> Result[Sequence[FlownCase]]:
    """Simulate flights over an obstacle, like `benchtool simulate flight`.

    Tables: `oge` (PID, no obstacle) and one per controller.

    Args:
        controllers: built-in names and user classes.
        permit: called with user code of the model before it runs; by default this raises.
        options: options of the command by name: ``case="edge"``, ``z_over_r=1.5``, ``seed=3``.
    """
    inputs = build_inputs(FlightInputs, options)
    return _saved(flight_result(inputs, controllers, permit), inputs.study.out)


def _saved(result: Result[Found], out: Path | None) -> Result[Found]:
    """Write a result if a folder is given, and return it."""
    if out is not None:
        result.save(out)
    return result
