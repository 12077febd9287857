"""Sweep from inputs to run folder: plan display, arming, sweep, closing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchtool.acquire.arming import arming_prompt
from benchtool.acquire.calibration import find_calibration
from benchtool.acquire.check_plan import PlanExtremes, check_plan
from benchtool.acquire.inputs import SweepInputs, resolve_rig
from benchtool.acquire.operator import POLL_INTERVAL_S, Operator, arm, close_stopped, describe_bench
from benchtool.acquire.plan import Plan, read_plan
from benchtool.acquire.resume import (
    ResumeState,
    load_resume_state,
    prepare_resume,
    require_same_device,
)
from benchtool.acquire.run_creation import new_run
from benchtool.acquire.stage_selection import check_stage, select_stage
from benchtool.acquire.stop_listener import accept_stops
from benchtool.acquire.sweep import SweepStart, run_sweep
from benchtool.acquire.visit_order import (
    expected_duration_s,
    format_duration,
    plan_settings,
    plan_visits,
)
from benchtool.bench.bench import Bench
from benchtool.bench.drivers import open_bench
from benchtool.bench.guard import GuardedBench
from benchtool.bench.signals import ClosingSignals
from benchtool.core.errors import InputError, check_name
from benchtool.core.inputs import Source, items
from benchtool.core.rig import Rig
from benchtool.core.text import pluralize
from benchtool.core.user_code import CodePermit, check_code_allowed
from benchtool.data.calibration import read_calibration
from benchtool.data.run.run import Run, check_not_existing


def base_inputs(values: Mapping[str, Any], source: Source) -> SweepInputs:
    """Return the base inputs with the plan of a file, or the default plan."""
    if values.get("resume") is not None:
        clash = [item.display_name(source) for item in items(Plan) if item.name in values]
        if clash := (clash or [item.display_name(source) for item in items(SweepInputs)
                               if item.key == "plan_file" and "plan" in values]):  # fmt: skip
            resume = "--resume" if source == "option" else "resume"
            raise InputError(
                f"{clash[0]} and {resume} are both given; a resumed run keeps its plan"
            )
    return SweepInputs(plan=read_plan(values["plan"]) if "plan" in values else Plan())


def run_sweep_to_folder(
    inputs: SweepInputs, operator: Operator, permit: CodePermit, rig: Rig | None = None
) -> Run | None:
    """Sweep or resume a run; return the run, None for a dry run.

    Raises:
        InputError: incomplete inputs, or not confirmed; no motor was started.
        PlanError: the plan exceeds the limits of rig or device.
        BenchError, RunInterrupted: reason of an early end; motors are at zero.
    """
    address = inputs.address
    if inputs.resume is None:
        if not address:
            raise InputError("no bench address; give one, for example sim:pquad")
        rig = rig or resolve_rig(address, inputs.rig)
        resolved = inputs.plan.resolved(rig)
        if inputs.out is not None:
            check_not_existing(inputs.out)
        check_name("run", resolved.name, ascii_only=True)
        return record_sweep(replace(inputs, plan=resolved), rig, operator, permit)
    resume_state = load_resume_state(Run.open(inputs.resume))
    if not resume_state.remaining and not inputs.dry_run:
        prepare_resume(resume_state)  # closes a complete run and raises
    inputs = replace(
        inputs,
        address=address or str(resume_state.run.metadata.get("address", "")),
        stage=inputs.stage or resume_state.stage,
        plan=resume_state.plan,
    )
    permit = permit if address else check_code_allowed
    return record_sweep(inputs, resume_state.rig, operator, permit, resume_state)


def record_sweep(
    inputs: SweepInputs,
    rig: Rig,
    operator: Operator,
    permit: CodePermit,
    resume_state: ResumeState | None = None,
) -> Run | None:
    """Show a plan, arm and sweep; return the run, None for a dry run."""
    # Check all inputs before any output or opening.
    check_stage(inputs.stage, plate=inputs.plan.plate.used)
    if inputs.calibration not in (None, "none"):
        read_calibration(Path(str(inputs.calibration)))
    bench = open_bench(inputs.address, permit)
    expected = check_plan(inputs.plan, rig)
    text = plan_text(inputs.plan, rig, expected, resume_state)
    is_virtual = inputs.address.startswith("sim:")
    operator.inform(f"{text} bench time; a simulation runs faster" if is_virtual else text)
    if inputs.dry_run:
        operator.inform("dry run: no bench was opened")
        return None
    start = prepare_resume(resume_state) if resume_state else None
    return _sweep(bench, inputs, rig, operator, resume_state, start)


def plan_text(
    plan: Plan, rig: Rig, expected: PlanExtremes, resume_state: ResumeState | None = None
) -> str:
    """Return the description of a resolved plan, or of the remaining part of a run."""
    visits = plan_visits(plan, rig)
    remaining = [
        visit for visit in visits if resume_state is None or visit.point not in resume_state.done
    ]
    counts = {
        kind: sum(visit.kind == kind for visit in remaining) for kind in ("reference", "anchor")
    }
    radius_m = rig.propulsion.radius_m
    distances = ", ".join(f"{z_m / radius_m:g}" for z_m in plan.plate.distances_m)
    where = (
        f"plate z/R {distances}; tilt {_list(plan.plate.tilts_deg)} deg; "
        f"lateral {_list(plan.plate.lateral_m)} m"
        if plan.plate.used
        else "no plate: parked if the bench moves one; else remove it, at least 4 radii away"
    )
    parts = (
        f", including {pluralize(counts['reference'], 'reference')} and "
        f"{pluralize(counts['anchor'], 'anchor')}"
        if plan.plate.used
        else ""
    )
    return (
        f"rig {rig.name}: {rig.title}\n"
        f"{where}\n"
        f"pulses {_list(plan.throttle.pwm_us)} us on rotors {_list(plan.throttle.rotors_on)}\n"
        f"{pluralize(len(plan_settings(plan, rig)), 'setting')}, "
        f"{pluralize(plan.repeats or 1, 'repeat')}, {plan.order.kind} with seed {plan.order.seed}: "
        f"{pluralize(len(remaining), 'visit')}{parts}\n"
        f"within limits: at most {expected.pwm_us:g} us, about {expected.rpm:.0f} rpm and "
        f"{expected.thrust_N:.1f} N of {rig.limits.thrust_N:g} N\n"
        f"expected duration {format_duration(expected_duration_s(plan, rig, remaining))}"
    )


def _list(numbers: tuple[float, ...]) -> str:
    return ", ".join(f"{number:g}" for number in numbers)


def _sweep(
    device: Bench,
    inputs: SweepInputs,
    rig: Rig,
    operator: Operator,
    resume_state: ResumeState | None,
    start: SweepStart | None,
) -> Run:
    """Open the bench, arm, sweep, and close the run in every case."""
    from benchtool.data.parquet import load_library

    load_library()
    plan = inputs.plan
    run: Run | None = None
    has_started = False
    with ClosingSignals() as closing:
        try:
            with accept_stops(GuardedBench(device, rig), inputs.address) as bench:
                identity = bench.identity
                describe_bench(operator, identity, rig)
                expected = check_plan(plan, rig, identity.limits)
                calibration = (
                    resume_state.calibration
                    if resume_state
                    else find_calibration(inputs.calibration, identity)
                )
                stage = select_stage(
                    inputs.stage,
                    bench,
                    rig,
                    lambda text: operator.answer(
                        text, lambda: bench.read_and_buffer(POLL_INTERVAL_S)
                    ),
                    plate=plan.plate.used,
                )
                source = f"calibration {calibration.id}" if calibration else "the device only"
                text = f"{arming_prompt(plan, rig, expected)}\nthrust calibrated by {source}"
                arm(operator, text, bench, rig, unattended=inputs.yes)
                with bench.interruptible():
                    stage.open()
                try:
                    if resume_state:
                        require_same_device(resume_state, identity)
                        run = resume_state.run
                    else:
                        run = new_run(
                            (inputs.runs, inputs.out),
                            plan,
                            rig,
                            identity,
                            operator=inputs.operator,
                            air=inputs.air,
                            calibration=calibration,
                        )
                    operator.inform(f"run {run.path}")
                    radius_m = rig.propulsion.radius_m if plan.plate.used else None
                    has_started = True
                    closing.ignore_signals()
                    with operator.display(radius_m) as display:
                        summary = run_sweep(
                            bench,
                            stage,
                            plan,
                            rig,
                            run,
                            display,
                            calibration=calibration,
                            start=start,
                        )
                finally:
                    stage.close()
        except BaseException:
            if run is not None and has_started:
                advice = f"resume with: benchtool sweep --resume {run.path}"
                close_stopped(operator, run, advice)
            raise
        run.close()
    simulated = " (simulated)" if identity.simulated else ""
    operator.inform(f"{summary.text(simulated)}; in {run.path}")
    return run
