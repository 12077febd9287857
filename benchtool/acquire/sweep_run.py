"""From inputs to a run folder: show the plan, open the bench, arm, sweep, close the run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchtool.acquire.arming import arming_prompt
from benchtool.acquire.calibration import calibration_for
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
from benchtool.acquire.stage_selection import check_stage, stage_for
from benchtool.acquire.stop_listener import accept_stops
from benchtool.acquire.sweep import SweepStart, run_sweep
from benchtool.acquire.visit_order import expected_duration_s, minutes, plan_settings, plan_visits
from benchtool.bench.bench import Bench
from benchtool.bench.drivers import open_bench
from benchtool.bench.guard import GuardedBench
from benchtool.bench.signals import ClosingSignals
from benchtool.core.errors import InputError, check_name
from benchtool.core.inputs import Source, items
from benchtool.core.plural import pluralize
from benchtool.core.rig import Rig
from benchtool.core.user_code import CodePermit, check_code_allowed
from benchtool.data.calibration import read_calibration
from benchtool.data.run.run import Run, check_not_existing


def base_inputs(given: Mapping[str, Any], source: Source) -> SweepInputs:
    """Return the plan that what was given goes over: that of a file, or none."""
    if given.get("resume") is not None:
        clash = [item.display_name(source) for item in items(Plan) if item.name in given]
        if clash := (clash or [item.display_name(source) for item in items(SweepInputs)
                               if item.key == "plan_file" and "plan" in given]):  # fmt: skip
            resume = "--resume" if source == "option" else "resume"
            raise InputError(
                f"{clash[0]} and {resume} are both given; a resumed run keeps the plan that it has"
            )
    return SweepInputs(plan=read_plan(given["plan"]) if "plan" in given else Plan())


def run_sweep_to_folder(
    inputs: SweepInputs, operator: Operator, permit: CodePermit, rig: Rig | None = None
) -> Run | None:
    """Sweep as inputs say, or go on with a run; return the run, None of a dry one.

    Raises:
        InputError: the inputs do not say enough, or nobody confirms; nothing was spun.
        PlanError: the limits of rig or device do not allow the plan.
        BenchError, RunStopped: why it ended early; motors are at zero.
    """
    address = inputs.address
    if inputs.resume is None:
        if not address:
            raise InputError("which bench? name its address, for example sim:pquad")
        stands = rig or resolve_rig(address, inputs.rig)
        resolved = inputs.plan.resolved(stands)
        if inputs.out is not None:
            check_not_existing(inputs.out)
        check_name("run", resolved.name, ascii_only=True)
        return record_sweep(replace(inputs, plan=resolved), stands, operator, permit)
    rest = load_resume_state(Run.open(inputs.resume))
    if not rest.left and not inputs.dry_run:
        prepare_resume(rest)  # closes it and says that nothing is left
    inputs = replace(
        inputs,
        address=address or str(rest.run.metadata.get("address", "")),
        stage=inputs.stage or rest.stage,
        plan=rest.plan,
    )
    return record_sweep(inputs, rest.rig, operator, permit if address else check_code_allowed, rest)


def record_sweep(
    inputs: SweepInputs,
    rig: Rig,
    operator: Operator,
    permit: CodePermit,
    rest: ResumeState | None = None,
) -> Run | None:
    """Show a plan, arm and sweep; return the run, None of a dry one.

    Args:
        rest: a run to go on with.
    """
    # Everything that was given is looked at before anything is said or opened.
    check_stage(inputs.stage, plate=inputs.plan.plate.used)
    if inputs.calibration not in (None, "none"):
        read_calibration(Path(str(inputs.calibration)))
    bench = open_bench(inputs.address, permit)
    expected = check_plan(inputs.plan, rig)
    text = plan_text(inputs.plan, rig, expected, rest)
    virtual = inputs.address.startswith("sim:")
    operator.inform(
        f"{text} of the bench's clock; a simulated one runs faster" if virtual else text
    )
    if inputs.dry_run:
        operator.inform("dry run: nothing was opened, nothing spins")
        return None
    start = prepare_resume(rest) if rest else None
    return _sweep(bench, inputs, rig, operator, rest, start)


def plan_text(
    plan: Plan, rig: Rig, expected: PlanExtremes, resume_state: ResumeState | None = None
) -> str:
    """Return what a resolved plan, or the rest of a run, will do, in lines."""
    visits = plan_visits(plan, rig)
    left = [
        visit for visit in visits if resume_state is None or visit.point not in resume_state.done
    ]
    counts = {kind: sum(visit.kind == kind for visit in left) for kind in ("reference", "anchor")}
    radius_m = rig.propulsion.radius_m
    distances = ", ".join(f"{z_m / radius_m:g}" for z_m in plan.plate.distances_m)
    where = (
        f"plate z/R {distances}; tilt {_list(plan.plate.tilts_deg)} deg; "
        f"lateral {_list(plan.plate.lateral_m)} m"
        if plan.plate.used
        else "no plate: parked where the bench moves one; else take it away, 4 radii at least"
    )
    apart = (
        f", of them {pluralize(counts['reference'], 'reference')} and "
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
        f"{pluralize(len(left), 'visit')}{apart}\n"
        f"limits hold: at most {expected.pwm_us:g} us, about {expected.rpm:.0f} rpm and "
        f"{expected.thrust_N:.1f} N of {rig.limits.thrust_N:g} N\n"
        f"expected duration {minutes(expected_duration_s(plan, rig, left))}"
    )


def _list(numbers: tuple[float, ...]) -> str:
    return ", ".join(f"{number:g}" for number in numbers)


def _sweep(
    device: Bench,
    inputs: SweepInputs,
    rig: Rig,
    operator: Operator,
    rest: ResumeState | None,
    start: SweepStart | None,
) -> Run:
    """Open the bench, arm, sweep, and close the run whatever happened."""
    from benchtool.data.parquet import load_library

    load_library()
    plan = inputs.plan
    run: Run | None = None
    measured = False
    with ClosingSignals() as closing:
        try:
            with accept_stops(GuardedBench(device, rig), inputs.address) as bench:
                identity = bench.identity
                describe_bench(operator, identity, rig)
                expected = check_plan(plan, rig, identity.limits)
                scale = rest.calibration if rest else calibration_for(inputs.calibration, identity)
                mover = stage_for(
                    inputs.stage,
                    bench,
                    rig,
                    lambda text: operator.answer(text, lambda: bench.listen(POLL_INTERVAL_S)),
                    plate=plan.plate.used,
                )
                by = f"calibration {scale.id}" if scale else "the device, without a calibration"
                text = f"{arming_prompt(plan, rig, expected)}\nthrust by {by}"
                arm(operator, text, bench, rig, unattended=inputs.yes)
                with bench.interruptible():
                    mover.open()
                try:
                    if rest:
                        require_same_device(rest, identity)
                        run = rest.run
                    else:
                        run = new_run(
                            (inputs.runs, inputs.out),
                            plan,
                            rig,
                            identity,
                            operator=inputs.operator,
                            air=inputs.air,
                            calibration=scale,
                        )
                    operator.inform(f"run {run.path}")
                    radius_m = rig.propulsion.radius_m if plan.plate.used else None
                    measured = True
                    closing.begin()
                    with operator.display(radius_m) as display:
                        summary = run_sweep(
                            bench, mover, plan, rig, run, display, calibration=scale, start=start
                        )
                finally:
                    mover.close()
        except BaseException:
            if run is not None and measured:
                advice = f"go on with: benchtool sweep --resume {run.path}"
                close_stopped(operator, run, advice)
            raise
        run.close()
    simulated = " (simulated)" if identity.simulated else ""
    operator.inform(f"{summary.text(simulated)}; in {run.path}")
    return run
