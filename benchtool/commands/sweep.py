"""`benchtool sweep`: from a plan to a run folder."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchtool.acquire.inputs import SweepInputs
from benchtool.acquire.plan import Plan
from benchtool.acquire.stage_choice import check_stage, stage_for
from benchtool.bench.signals import ClosingSignals
from benchtool.commands.declared import declared
from benchtool.commands.terminal.messages import announce_code, close_stopped
from benchtool.commands.terminal.sweep_operator import LOOK_S, answer_to, arm, say_of_bench
from benchtool.core.counted import counted
from benchtool.core.errors import InputError
from benchtool.core.inputs import items
from benchtool.core.own_code import CodePermit, refuse_code

if TYPE_CHECKING:
    from benchtool.acquire.check_plan import Expected
    from benchtool.acquire.resume import Unfinished
    from benchtool.acquire.sweep import Start
    from benchtool.bench.bench import Bench
    from benchtool.core.rig import Rig
    from benchtool.data.run.run import Run


def _base(given: dict[str, Any]) -> SweepInputs:
    """Return the plan that options go over: that of a file, or none."""
    from benchtool.acquire.plan import read_plan

    if given.get("resume") is not None:
        clash = [item.option for item in items(Plan) if item.name in given]
        if clash := (clash or ["--plan"] * ("plan" in given)):
            raise InputError(
                f"{clash[0]} and --resume are both given; a resumed run keeps the plan that it has"
            )
    return SweepInputs(plan=read_plan(given["plan"]) if "plan" in given else Plan())


@declared(SweepInputs, _base)
def sweep(inputs: SweepInputs) -> None:
    """Sweep plate distance and throttle into a run folder."""
    from benchtool.acquire.inputs import rig_for
    from benchtool.acquire.resume import prepare, unfinished
    from benchtool.data.run.run import Run, check_run_name, refuse_taken

    address = inputs.address
    if inputs.resume is not None:
        rest = unfinished(Run.open(inputs.resume))
        if not rest.left and not inputs.dry_run:
            prepare(rest)  # closes it and says that nothing is left
        resolved, stands = rest.plan, rest.rig
        permit = announce_code if address else refuse_code
        address = address or str(rest.run.metadata.get("address", ""))
        inputs = replace(inputs, stage=inputs.stage or rest.stage)
    else:
        if not address:
            raise InputError("which bench? name its address, for example sim:pquad")
        rest, permit = None, announce_code
        stands = rig_for(address, inputs.rig)
        resolved = inputs.plan.resolved(stands)
        if inputs.out is not None:
            refuse_taken(inputs.out)
        check_run_name(resolved.name)
    record_sweep(replace(inputs, address=address, plan=resolved), stands, rest, permit)


def record_sweep(
    inputs: SweepInputs,
    stands: Rig,
    rest: Unfinished | None = None,
    permit: CodePermit = announce_code,
) -> Run | None:
    """Show a plan, arm and sweep; return the run, None of a dry one.

    Args:
        inputs: with address and a resolved plan.
        stands: the rig on the bench.
        rest: a run to go on with.
        permit: called with Python files that the address names.
    """
    from benchtool.acquire.check_plan import check_plan
    from benchtool.acquire.resume import prepare
    from benchtool.bench.drivers import open_bench
    from benchtool.data.calibration import read_calibration

    # Everything that was typed is looked at before anything is printed or opened.
    check_stage(inputs.stage, stands)
    if inputs.calibration not in (None, "none"):
        read_calibration(Path(str(inputs.calibration)))
    bench = open_bench(inputs.address, permit)
    expected = check_plan(inputs.plan, stands)
    _show_plan(inputs.plan, stands, expected, rest)
    if inputs.dry_run:
        print("dry run: nothing was opened, nothing spins")
        return None
    start = prepare(rest) if rest else None
    return _sweep(bench, inputs, stands, rest, start)


def _show_plan(plan: Plan, rig: Rig, expected: Expected, rest: Unfinished | None) -> None:
    from benchtool.acquire.order import expected_duration_s, minutes, settings_of, visits_of

    visits = visits_of(plan, rig)
    left = [visit for visit in visits if rest is None or visit.point not in rest.done]
    counts = {kind: sum(visit.kind == kind for visit in left) for kind in ("reference", "anchor")}
    radius_m = rig.propulsion.radius_m
    distances = ", ".join(f"{z_m / radius_m:g}" for z_m in plan.plate.distances_m)
    print(f"rig {rig.name}: {rig.title}")
    print(f"plate z/R {distances}; tilt {_list(plan.plate.tilts_deg)} deg; ", end="")
    print(f"lateral {_list(plan.plate.lateral_m)} m")
    print(f"pulses {_list(plan.throttle.pwm_us)} us on rotors {_list(plan.throttle.rotors_on)}")
    print(
        f"{counted(len(settings_of(plan, rig)), 'setting')}, "
        f"{counted(plan.repeats or 1, 'repeat')}, {plan.order.kind} with seed {plan.order.seed}: "
        f"{counted(len(left), 'visit')}, of them "
        f"{counted(counts['reference'], 'reference')} and {counted(counts['anchor'], 'anchor')}"
    )
    print(
        f"limits hold: at most {expected.pwm_us:g} us, about {expected.rpm:.0f} rpm and "
        f"{expected.thrust_N:.1f} N of {rig.limits.thrust_N:g} N"
    )
    print(f"expected duration {minutes(expected_duration_s(plan, rig, left))}", flush=True)


def _list(numbers: tuple[float, ...]) -> str:
    return ", ".join(f"{number:g}" for number in numbers)


def _sweep(
    device: Bench, inputs: SweepInputs, rig: Rig, rest: Unfinished | None, start: Start | None
) -> Run:
    """Open the bench, arm, sweep, and close the run whatever happened."""
    from benchtool.acquire.arming import arming_text
    from benchtool.acquire.calibration import calibration_for
    from benchtool.acquire.check_plan import check_plan
    from benchtool.acquire.new_run import new_run
    from benchtool.acquire.resume import require_same_device
    from benchtool.acquire.sweep import run_sweep
    from benchtool.bench.guard import GuardedBench
    from benchtool.commands.terminal.sweep_display import display_for
    from benchtool.data.parquet import load_library

    load_library()
    plan = inputs.plan
    run: Run | None = None
    measured = False
    with ClosingSignals() as closing:
        try:
            with GuardedBench(device, rig) as bench:
                identity = bench.identity
                say_of_bench(identity, rig)
                expected = check_plan(plan, rig, identity.limits)
                scale = rest.calibration if rest else calibration_for(inputs.calibration, identity)
                mover = stage_for(
                    inputs.stage,
                    bench,
                    rig,
                    lambda text: answer_to(text, lambda: bench.listen(LOOK_S)),
                )
                by = f"calibration {scale.id}" if scale else "the device's own newtons"
                text = f"{arming_text(plan, rig, expected)}\nthrust by {by}"
                arm(text, bench, rig, unattended=inputs.yes)
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
                    print(f"run {run.path}", flush=True)
                    measured = True
                    closing.begin()
                    with display_for(rig.propulsion.radius_m) as display:
                        summary = run_sweep(
                            bench, mover, plan, rig, run, display, calibration=scale, start=start
                        )
                finally:
                    mover.close()
        except BaseException:
            if run is not None and measured:
                close_stopped(run, f"go on with: benchtool sweep --resume {run.path}")
            raise
        run.close()
    simulated = " (simulated)" if identity.simulated else ""
    print(f"{summary.text(simulated)}; in {run.path}")
    return run
