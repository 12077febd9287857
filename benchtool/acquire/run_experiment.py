"""Run of an experiment from the inputs of command line, page or Python."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from benchtool.acquire.inputs import RecordInputs, SweepInputs, check_stage, resolve_rig
from benchtool.acquire.operator import Operator, Unattended
from benchtool.acquire.pitch import PitchRecording
from benchtool.acquire.plan import Plan, read_plan
from benchtool.acquire.record import RunProgress
from benchtool.acquire.resume import load_resume_state
from benchtool.acquire.session import Experiment, run_session
from benchtool.acquire.sweep import Sweep
from benchtool.core.errors import InputError, check_name
from benchtool.core.inputs import Source, build_inputs, items
from benchtool.core.rig import Rig
from benchtool.core.user_code import CodePermit, check_code_allowed
from benchtool.data.calibration import read_calibration
from benchtool.data.run.run import Run, check_not_existing


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
    operator: Operator | None,
    permit: CodePermit,
) -> Path:
    """Run an experiment from keyword arguments; return its run folder."""
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
    run = run_experiment(inputs, operator or Unattended(), permit, rig)
    assert run is not None
    return run.path


def run_experiment(
    inputs: SweepInputs | RecordInputs,
    operator: Operator,
    permit: CodePermit,
    rig: Rig | None = None,
) -> Run | None:
    """Sweep, resume a run or record a pitch experiment; raises as `run_session`.

    Args:
        rig: default: that of the inputs or of a `sim:` address.
    """
    # The address in a run's metadata may name user code.
    permit = permit if inputs.address else check_code_allowed
    return run_session(build_experiment(inputs, rig), operator, permit)


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
