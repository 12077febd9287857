"""Session of an experiment, from the inputs of command line, page or Python.

`acquire` is the order of operations on an open bench, for command line, page and Python, which
differ in their operator only. `run_experiment` opens the bench before and closes the run after it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any, Literal

from benchtool.acquire.experiment import Experiment
from benchtool.acquire.inputs import RecordInputs, SweepInputs, check_stage, resolve_rig
from benchtool.acquire.operator import (
    ARMING_QUESTION,
    CONFIRMATION,
    POLL_INTERVAL_S,
    WARNING,
    Operator,
    Quiet,
    arming_warnings,
    require_unattended,
)
from benchtool.acquire.pitch import PitchRecording
from benchtool.acquire.plan import Plan, read_plan
from benchtool.acquire.record import RunProgress
from benchtool.acquire.resume import load_resume_state
from benchtool.acquire.stop_listener import accept_stops
from benchtool.acquire.sweep import Sweep
from benchtool.bench.bench import DeviceInfo
from benchtool.bench.drivers import open_bench
from benchtool.bench.guard import GuardedBench
from benchtool.bench.stop_requests import ClosingSignals
from benchtool.core.errors import BenchtoolError, InputError, RunInterrupted, check_name
from benchtool.core.inputs import Source, build_inputs, items
from benchtool.core.rig import Rig
from benchtool.core.user_code import CodePermit, check_code_allowed
from benchtool.data.calibration import read_calibration
from benchtool.data.run.run import Run, check_not_existing

RECORDED = "recorded data are in"  # begin of the last line of a stopped run


def base_inputs(values: Mapping[str, Any], source: Source) -> SweepInputs:
    """Return the base inputs with the plan of a file, or the default plan."""
    if values.get("resume") is not None:
        options = [*items(Plan), *(item for item in items(SweepInputs) if item.key == "plan_file")]
        clash = [item.display_name(source) for item in options if item.name in values]
        if clash:
            resume = "--resume" if source == "option" else "resume"
            raise InputError(
                f"{clash[0]} and {resume} are both given; a resumed run keeps its plan"
            )
    return SweepInputs(plan=read_plan(values["plan"]) if "plan" in values else Plan())


def run_keywords(
    command: Literal["sweep", "record"],
    values: dict[str, Any],
    rig: Rig | str | Path | None,
    operator: Operator | str | None,
    permit: CodePermit,
    *,
    progress: bool = False,
) -> Path:
    """Run an experiment from keyword arguments; return its run folder.

    Args:
        operator: interface for the arming confirmation, or name of the operator.
        progress: show a progress bar, if `operator` has no display.
    """
    if isinstance(operator, str):
        values, operator = {"operator": operator} | values, None
    if not values["yes"] and operator is None:
        raise InputError(
            f"not armed: bt.{command} turns motors and needs a confirmation; use yes=True (for a "
            f"simulated bench, or one whose bench check passed today), or benchtool {command} in "
            f"a terminal"
        )
    if values.pop("dry_run", False):
        raise InputError(f"dry_run needs the command line: benchtool {command} ADDRESS --dry-run")
    if not isinstance(rig, Rig):
        values, rig = {"rig": None if rig is None else str(rig)} | values, None
    inputs: SweepInputs | RecordInputs
    if command == "sweep":
        inputs = build_inputs(SweepInputs, values, base=base_inputs(values, "keyword"))
    else:
        inputs = build_inputs(RecordInputs, values)
    quiet = Quiet(progress=progress)
    try:
        run = run_experiment(inputs, operator or quiet, permit, rig)
    except BenchtoolError as error:
        if quiet.last_line.startswith(RECORDED):
            error.add_note(quiet.last_line)
        raise
    assert run is not None
    return run.path


def build_experiment(
    inputs: SweepInputs | RecordInputs, rig: Rig | None = None, progress: RunProgress | None = None
) -> Experiment:
    """Return the experiment of inputs: sweep, remaining sweep of a run, or pitch experiment.

    Args:
        progress: of a pitch experiment.

    Raises:
        InputError: incomplete inputs, or an unknown stage or calibration.
        WouldOverwrite: the run folder exists.
    """
    resume_state = None
    if isinstance(inputs, SweepInputs) and inputs.resume is not None:
        resume_state = load_resume_state(Run.open(inputs.resume))
        address = inputs.address or str(resume_state.run.metadata.get("address", ""))
        stage = inputs.stage or resume_state.stage
        inputs = replace(inputs, address=address, stage=stage, plan=resume_state.plan)
        rig = resume_state.rig
    else:
        if not inputs.address:
            raise InputError("no bench address; give one, for example sim:pquad")
        rig = rig or resolve_rig(inputs.address, inputs.rig)
        if inputs.out is not None:
            check_not_existing(inputs.out)
        if isinstance(inputs, RecordInputs):
            return PitchRecording(inputs, rig, progress)
        inputs = replace(inputs, plan=inputs.plan.resolved(rig))
        check_name("run", inputs.plan.name, ascii_only=True)
    check_stage(inputs.stage, plate=inputs.plan.plate.used)
    if inputs.calibration not in (None, "none"):
        read_calibration(Path(inputs.calibration))
    return Sweep(inputs, rig, resume_state)


def run_experiment(
    inputs: SweepInputs | RecordInputs,
    operator: Operator,
    permit: CodePermit,
    rig: Rig | None = None,
) -> Run | None:
    """Sweep, resume a run or record a pitch experiment, and close the run; None for a dry run.

    Args:
        rig: default: that of the inputs or of a `sim:` address.

    Raises:
        InputError: incomplete inputs, or not confirmed; no motor was started.
        PlanError: the limits of rig or device are exceeded.
        BenchError, RunInterrupted: reason of an early end; motors are at zero.
    """
    from benchtool.data.parquet import load_library

    # The address in a run's metadata may name user code.
    permit = permit if inputs.address else check_code_allowed
    experiment = build_experiment(inputs, rig)
    inputs = experiment.inputs
    device = open_bench(inputs.address, permit)
    for line in experiment.prepare():
        operator.inform(line)
    if inputs.dry_run:
        return None
    # An open bench is read without a pause, so libraries are imported before.
    load_library()
    display = experiment.display(operator)
    with ClosingSignals() as closing:
        try:
            with accept_stops(GuardedBench(device, experiment.rig), inputs.address) as bench:
                run = acquire(
                    bench, experiment, operator, display, lambda run: closing.ignore_signals()
                )
            _describe_end(operator, bench)
        except BaseException:
            if experiment.run is not None:
                _close_stopped(operator, experiment.run, experiment.advice)
            raise
        run.close()
    simulated = " (simulated)" if run.metadata.get("simulated") else ""
    operator.inform(f"{experiment.summary(simulated)}; in {run.path}")
    return run


def acquire(
    bench: GuardedBench,
    experiment: Experiment,
    operator: Operator,
    display: AbstractContextManager[RunProgress],
    begin: Callable[[Run], object],
) -> Run:
    """Check, arm and record an experiment on an open bench; motors are at zero when it ends.

    Args:
        begin: called before the first pulse; the caller must close the run, as after an error.

    Raises:
        BenchtoolError: the run could not begin, or ended early.
    """
    rig = experiment.rig
    _describe_bench(operator, bench.identity, rig)
    if text := experiment.check(bench, operator):
        if experiment.inputs.yes:
            require_unattended(bench.identity, rig, datetime.now().astimezone().date())
            operator.inform(text)
        else:
            _confirm_arming(operator, text, bench)
    with experiment.open_stage(bench):
        run = experiment.create_run(bench.identity)
        operator.inform(f"run {run.path}")
        experiment.run = run
        begin(run)
        with display as progress:
            experiment.record(bench, run, progress)
    return run


@contextmanager
def open_motor_test(
    address: str, rig: Rig, text: str, operator: Operator, permit: CodePermit, *, yes: bool
) -> Iterator[GuardedBench]:
    """Open a bench whose motors turn without a run, after confirmation of the text.

    Args:
        yes: skip the confirmation; simulated benches only.
    """
    with accept_stops(GuardedBench(open_bench(address, permit), rig), address) as bench:
        _describe_bench(operator, bench.identity, rig)
        if not yes:
            _confirm_arming(operator, text, bench)
        elif not bench.identity.simulated:
            raise InputError("--yes is for simulated benches only; remove it and type ARM")
        yield bench
    _describe_end(operator, bench)


def _describe_bench(operator: Operator, identity: DeviceInfo, rig: Rig) -> None:
    """Show the warnings of a bench before arming."""
    for warning in arming_warnings(identity, rig):
        operator.inform(f"{WARNING}{warning}")
    if identity.speed != 1.0:
        operator.inform(f"bench at {identity.speed:g} times real time; all times are bench time")


def _describe_end(operator: Operator, bench: GuardedBench) -> None:
    """Show rotors without confirmed standstill at a normal end."""
    if (state := bench.standstill) is not None and not state.is_confirmed:
        operator.inform(f"{WARNING}{state.text}")


def _confirm_arming(operator: Operator, text: str, bench: GuardedBench) -> None:
    """Ask for a typed confirmation before motors spin.

    Raises:
        InputError: no terminal to confirm.
        RunInterrupted: not confirmed.
    """
    operator.inform(text)
    is_virtual = bench.identity.address.startswith("sim:")
    meanwhile = None if is_virtual else lambda: bench.read(POLL_INTERVAL_S)
    with bench.interruptible():
        answer = operator.answer(ARMING_QUESTION, meanwhile)
    if answer.strip() != CONFIRMATION:
        raise RunInterrupted(f"not armed: {CONFIRMATION} was not typed; no motor was started")


def _close_stopped(operator: Operator, run: Run, advice: str) -> None:
    """Write the tables of a stopped run and show its path and the advice, or the error."""
    try:
        run.close()
        if advice and run.metadata["state"] == "ended":
            advice = (
                f"every visit is measured and stored; check the reason of the stop, then continue "
                f"with: benchtool fit {run.path}"
            )
    except (BenchtoolError, OSError, MemoryError) as error:
        operator.warn(f"{run.path} was not closed: {error}")
        return
    with suppress(OSError):
        operator.inform("; ".join(filter(None, (f"{RECORDED} {run.path}", advice))))
