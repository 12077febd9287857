"""The public Python interface: what each command does, as a function that returns its result.

Inputs have the names, ranges and defaults of the command's options (`benchtool fit --help`), and a
wrong one is refused with the same sentence.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchtool.acquire.inputs import SweepInputs
from benchtool.acquire.operator import Operator, Unattended
from benchtool.acquire.sweep_run import base_inputs, run_sweep_to_folder
from benchtool.core.errors import InputError
from benchtool.core.inputs import build_inputs
from benchtool.core.rig import Propeller, Rig
from benchtool.core.rig_file import load_rig_by_name
from benchtool.core.user_code import CodePermit, check_code_allowed
from benchtool.data.catalogue.query import runs
from benchtool.data.columns import concatenate_frames, frame, frame_of_rows
from benchtool.data.derived import add_shared_errors, run_circumstances, with_quantities
from benchtool.data.propeller_file import load_propeller
from benchtool.data.run.read import is_run
from benchtool.explain.answer import ExplainResult
from benchtool.explain.inputs import ExplainInputs
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
from benchtool.report.compare.runs import Over
from benchtool.report.flight.pitch_study import PitchStudy
from benchtool.report.motor.page import MOTOR, motor_lines
from benchtool.report.replay.page import STAND
from benchtool.report.replay.replay_source import ReplaySource, read_recorded
from benchtool.report.report_file import kind_of
from benchtool.report.result import Data, Found, Result, estimate_row, saved_paths
from benchtool.report.style import look as figure_style
from benchtool.report.sweep.page import SWEEP
from benchtool.report.sweep.run import SweepRun, read_sweep_run
from benchtool.results import explain_result, fit_result, flight_result, pitch_result, pool_result
from benchtool.simulate.flight.inputs import FlightInputs
from benchtool.simulate.flight.study import FlownCase
from benchtool.simulate.flight.study import fly_and_measure as fly
from benchtool.simulate.pitch.inputs import PitchInputs
from benchtool.simulate.user_controller import Controllers

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "Effect", "Model", "Result", "Rig", "compare", "explain", "export", "figure_style", "fit",
    "fly", "load_model", "load_rig", "motor", "pool", "read", "runs", "simulate_flight",
    "simulate_pitch", "sweep",
]  # fmt: skip


def load_rig(rig: str | Path) -> Rig:
    """Return a rig: a shipped name (`benchtool library rigs`) or the path of a rig file."""
    return load_rig_by_name(rig)


def load_model(model: str | Path, permit: CodePermit = check_code_allowed) -> Model:
    """Return a model: a shipped name (`benchtool library models`) or the path of a model file.

    Args:
        permit: called with the file of own effects before it is run; refused when left out.
    """
    return _load_model(model, permit=permit).model


def read(path: str | Path) -> Result[SweepRun] | Result[ReplaySource]:
    """Read a run folder, a recording of `import` or `simulate`, or a log that `import` reads.

    Tables: `points`, `settings` and `samples` of a sweep; `samples` of anything else.

    Raises:
        FileFormatError: nothing there, or nothing that a report can be made of.
    """
    path = Path(path)
    if is_run(path) and kind_of(path) == "sweep":
        return _sweep(path)
    recorded = read_recorded(path)
    rows = len(recorded.recording)
    names = ", ".join(recorded.recording.names)
    return Result(
        found=recorded, path=path, _page=STAND,
        _summary=lambda one: f"{one.name}: {rows} rows of {names}",
        _tables={"samples": lambda one: frame(one.with_quantities())},
    )  # fmt: skip


def _sweep(path: Path) -> Result[SweepRun]:
    tables: dict[str, Callable[[SweepRun], pd.DataFrame]] = {
        "points": lambda run: frame(add_shared_errors(run.points, run_circumstances(path))),
        "settings": lambda run: frame(with_quantities(run.settings, run.quantities)),
    }
    run = read_sweep_run(path)
    if (samples := run.samples) is not None:
        tables["samples"] = lambda run: frame(samples)
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
    """Sweep plate distance and throttle into a run folder, as `benchtool sweep` does, and read it.

    Motors turn. Whatever ends the sweep, Ctrl-C or *Interrupt* of a notebook among it, stops them;
    a signal is seen where this is called in the main thread, as notebooks do.
    Tables: those of `read`.

    Args:
        bench: address, as ``"sim:pquad"``; not needed with ``resume=``.
        rig: on the bench; the one that a ``sim:`` address names when left out.
        yes: confirms that motors may turn, where nobody types it: on a simulated bench, or one
            whose `benchtool bench check` passed today.
        operator: whom to ask in place of `yes`.
        permit: called with Python files that the address names; refused when left out.
        options: of the command by name: ``z_over_r=(0.6, 1, 2)``, ``pwm=(1500, 1600)``,
            ``repeats=3``, ``plan="plan.toml"``, ``out="run"``, ``resume="run"``.

    Raises:
        InputError: nobody has confirmed, or the inputs do not say enough; nothing was spun.
        BenchError, RunStopped: why it ended early; motors are at zero, what was measured is in
            the run folder.
    """
    if not yes and operator is None:
        raise InputError(
            "nothing was armed: bt.sweep turns motors, and nobody has confirmed that; give "
            "yes=True (for a simulated bench, or one whose bench check passed today), or type "
            "benchtool sweep in a terminal, which asks before it arms"
        )
    if options.pop("dry_run", False):
        raise InputError("dry_run is of the command: benchtool sweep ADDRESS --dry-run")
    rig_name = None if isinstance(rig, Rig) or rig is None else str(rig)
    given = {"address": bench or None, "rig": rig_name, "yes": yes} | options
    inputs = build_inputs(SweepInputs, given, base=base_inputs(given, "keyword"))
    stands = rig if isinstance(rig, Rig) else None
    run = run_sweep_to_folder(inputs, operator or Unattended(), permit, stands)
    assert run is not None
    return _sweep(run.path)


def motor(
    runs: Data | Sequence[Data],
    *,
    mass_kg: float | None = None,
    rotors: int | None = None,
    extrapolate: bool = False,
    propeller: str | Path | None = None,
    rig: Rig | str | Path | None = None,
) -> Result[MotorFit]:
    """Fit thrust curve and motor constants to tests without a plate, as `benchtool motor` does.

    Tables: `constants` and `points`.

    Args:
        runs: run folders of one rig, references of plate sweeps among them, or logs of stands.
        mass_kg: of the vehicle whose hover point is worked out; the rig's when left out.
        rotors: that carry it; the rig's when left out.
        extrapolate: thrust to the rig's longest pulse and nominal voltage, however far.
        propeller: of logs that do not state theirs: name, file, or size in inches.
        rig: of logs; made from them when left out.

    Raises:
        InputError: none is given, the rigs differ, or the mass is too heavy.
        EstimationError: too few throttle levels, and no step of the pulse.
    """
    return Result(
        found=fit_motor(saved_paths(runs), mass_kg, *_stand(rig, propeller), rotors, extrapolate),
        _page=MOTOR, _summary=motor_lines,
        _tables={
            "constants": lambda one: frame_of_rows([estimate_row(e) for e in one.estimates]),
            "points": lambda one: frame(one.points.recording),
        },
    )  # fmt: skip


def fit(
    data: Data | Sequence[Data],
    model: str | Path,
    *,
    permit: CodePermit = check_code_allowed,
    **options: Any,
) -> Result[FitOutput]:
    """Fit a ground-effect model to run folders or CSV files, as `benchtool fit` does.

    Tables: `estimates`, `points` and `ratio`. The fitted model is `result.found.fitted`.

    Args:
        data: one or several.
        model: shipped name or path of a model file.
        permit: called with a model's own Python before it is run; refused when left out.
        options: of the command by name: ``free=("R_m",)``, ``method=("emcee",)``.

    Raises:
        InputError: the data or the model do not allow the fit.
        EstimationError: no estimate can be given.
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
    """Pool fits of several rigs, as `benchtool pool` does: mean, spread, and which rigs differ.

    Tables: `rigs` and `differences`. Draws of the posterior are in `result.found.pooled`.

    Args:
        fits: folders of `benchtool fit --out`, one of each rig.
        of: parameters that may differ; those without a unit when left out.
        shared: parameters that are the same in all rigs.
        seed: of everything random.

    Raises:
        InputError: fewer than two fits, fits without an answer, or fits that share data.
        NotConverged: the chains do not agree.
    """
    return pool_result([Path(path) for path in saved_paths(fits)], of, shared, seed)


def compare(
    data: Data | Sequence[Data], *, over: Over = "thrust", at_thrust_N: float | None = None
) -> Result[comparing.RunComparison]:
    """Set runs and recordings side by side, as `benchtool report --over --at-thrust` does.

    Tables: `curves`, and `best` where a thrust is wanted, the most efficient first.

    Args:
        data: one or several run folders or recordings of `benchtool import`.
        over: what the figure's axis is.
        at_thrust_N: where they are ranked.

    Raises:
        InputError: no run holds what they are to be drawn over.
    """
    one = comparing.compare_runs([Path(path) for path in saved_paths(data)], over, at_thrust_N)
    tables: dict[str, Callable[[comparing.RunComparison], pd.DataFrame]] = {
        "best": lambda one: frame_of_rows(comparing.best_rows(one)),
        "curves": lambda one: concatenate_frames(one.tables()),
    }
    if not one.found:
        del tables["best"]
    page, summary = comparing.COMPARISON, comparing.comparison_sentence
    return Result(found=one, _page=page, _summary=summary, _tables=tables)


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
    """Write a fitted model for a simulator, autopilot or firmware; return the files written.

    Args:
        model: folder of a fit or of a run without a plate, log of a stand, model file, or shipped
            model.
        to: "sdf", "mujoco", "rotorpy", "ardupilot", "px4", "betaflight", "c", or "all".
        out: new file, or for "all" new folder; named after the rig when left out.
        motor: runs without a plate or logs, whose motor constants go before the rig's.
        mass_kg: of the vehicle, for its hover point; the rig's when left out.
        rotors: that carry it; the rig's when left out.
        extrapolate: of the motor test, as `motor` takes it.
        propeller: of logs, likewise.
        rig: of logs, likewise.
        permit: called with a model's own Python before it is run; refused when left out.

    Raises:
        UnknownChoice: there is no such target or model.
        InputError: its data rejected the model.
        WouldOverwrite: a file is there already; nothing was written.
    """
    (path,) = saved_paths(model)
    vehicle = build_vehicle(path, saved_paths(motor), permit, *_stand(rig, propeller), extrapolate)
    hovering = replace(vehicle, mass_kg=mass_kg, rotors=rotors)
    return write_targets(hovering, to, None if out is None else Path(out))


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
) -> Result[ExplainResult]:
    """Name the effect that a model lacks, as `benchtool explain` does.

    Tables: `effects`, `gap` and `probabilities`. The verdict is `result.found.verdict`.

    Args:
        learn: recordings to learn from.
        check: others of the same bench, to check on.
        model: shipped name or path of a model file.
        permit: called with each Python file before it is run; refused when left out.
        options: of the command by name: ``effects="mine.py"``, ``rig="own.toml"`` (of CSV files;
            runs carry theirs), ``seed=3``, ``draws=500``, ``out="found"``.

    Raises:
        InputError: whatever is missing or cannot be read.
    """
    given = {"recordings": saved_paths(learn), "check": saved_paths(check), "model": str(model)}
    inputs = build_inputs(ExplainInputs, given | options)
    if inputs.bench is not None:
        raise InputError(
            "bench is of the command, which lets you confirm that motors turn: benchtool explain"
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
    """Simulate the pitch bench under each controller, as `benchtool simulate pitch` does.

    Tables: one of each controller, and `visits` of the plate.

    Args:
        controllers: built-in names, and classes of your own.
        permit: called with a model's own Python before it is run; refused when left out.
        options: of the command by name: ``schedule="plate"``, ``set={"body_lift.K_b": 2}``.
    """
    inputs = build_inputs(PitchInputs, options)
    return _saved(pitch_result(inputs, controllers, permit), inputs.study.out)


def simulate_flight(
    controllers: Controllers = ("pid", "observer", "feedforward"),
    *,
    permit: CodePermit = check_code_allowed,
    **options: Any,
) -> Result[Sequence[FlownCase]]:
    """Simulate flights over an obstacle, as `benchtool simulate flight` does.

    Tables: `oge` (PID over nothing) and one of each controller.

    Args:
        controllers: built-in names, and classes of your own.
        permit: called with a model's own Python before it is run; refused when left out.
        options: of the command by name: ``case="edge"``, ``z_over_r=1.5``, ``seed=3``.
    """
    inputs = build_inputs(FlightInputs, options)
    return _saved(flight_result(inputs, controllers, permit), inputs.study.out)


def _saved(result: Result[Found], out: Path | None) -> Result[Found]:
    """Write a result where the inputs name a folder, and return it."""
    if out is not None:
        result.save(out)
    return result
