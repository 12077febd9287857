"""`benchtool sweep`: from a plan to a run folder."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from benchtool.acquire.air import Air
    from benchtool.acquire.calibration import Calibration
    from benchtool.acquire.check_plan import Expected
    from benchtool.acquire.plan import Plan
    from benchtool.acquire.resume import Unfinished
    from benchtool.acquire.sweep import Start
    from benchtool.bench.bench import Bench
    from benchtool.bench.guard import GuardedBench
    from benchtool.core.rig import Rig
    from benchtool.store import Run


def command(
    address: Annotated[
        str, typer.Argument(help="The bench: sim:pquad, serial:PORT, tcp:HOST:PORT.")
    ] = "",
    plan: Annotated[Path | None, typer.Option(help="Plan file (TOML).")] = None,
    rig: Annotated[str | None, typer.Option(help="Rig by name, or a rig file.")] = None,
    z_m: Annotated[str | None, typer.Option(help="Plate distances in m: 0.06,0.12,0.24.")] = None,
    z_over_r: Annotated[
        str | None, typer.Option(help="Plate distances in rotor radii: 0.5,1,2.")
    ] = None,
    tilt: Annotated[str | None, typer.Option(help="Plate inclinations in degrees.")] = None,
    lateral: Annotated[
        str | None, typer.Option(help="Lateral plate positions in m, for partial coverage.")
    ] = None,
    pwm: Annotated[str | None, typer.Option(help="Pulse levels in us: 1400,1600.")] = None,
    rotors: Annotated[str | None, typer.Option(help="Rotors that turn: 1 or 1,2,3.")] = None,
    repeats: Annotated[
        int | None, typer.Option(help="Visits of each setting; 9 for one rotor, 5 for several.")
    ] = None,
    order: Annotated[
        str | None, typer.Option(help="randomised, counterbalanced or as_given.")
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed of the order.")] = None,
    anchor_every: Annotated[
        int | None, typer.Option(min=0, help="Repeat one setting after so many visits; 0: never.")
    ] = None,
    sample_s: Annotated[float | None, typer.Option(help="Samples of a point, in s.")] = None,
    name: Annotated[str | None, typer.Option(help="Name of the run.")] = None,
    runs: Annotated[Path, typer.Option(help="Where run folders are made.")] = Path("runs"),
    out: Annotated[Path | None, typer.Option(help="Exactly this run folder; must be new.")] = None,
    operator: Annotated[str, typer.Option(help="Who measures; the user when left out.")] = "",
    temperature: Annotated[float | None, typer.Option(help="Air temperature, degC.")] = None,
    pressure: Annotated[float | None, typer.Option(help="Air pressure here, hPa.")] = None,
    humidity: Annotated[float | None, typer.Option(help="Relative humidity, percent.")] = None,
    calibration: Annotated[
        str | None, typer.Option(help="Calibration file; the device's latest; none to use none.")
    ] = None,
    stage: Annotated[
        str | None, typer.Option(help="What moves the plate: device, hand, grbl:PORT?...")
    ] = None,
    yes: Annotated[
        bool, typer.Option("--yes", help="No typed arming: simulated or checked today.")
    ] = False,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Show plan and duration only.")
    ] = False,
    resume: Annotated[Path | None, typer.Option(help="Go on with this run folder.")] = None,
) -> None:
    """Sweep plate distance and throttle into a run folder."""
    from benchtool.acquire.calibration_file import read_calibration
    from benchtool.acquire.check_plan import check_plan
    from benchtool.acquire.plan import Plan, read_plan
    from benchtool.acquire.resume import prepare, unfinished
    from benchtool.acquire.stage_choice import check_stage
    from benchtool.acquire.sweep_options import air_of, rig_for, with_options
    from benchtool.bench.address import open_bench
    from benchtool.cli.announce_code import announce_code
    from benchtool.errors import InputError
    from benchtool.library.own_code import refuse_code
    from benchtool.store import Run
    from benchtool.store.run import check_run_name, refuse_taken

    given = {
        "z_m": z_m,
        "z_over_r": z_over_r,
        "tilt": tilt,
        "lateral": lateral,
        "pwm": pwm,
        "rotors": rotors,
        "repeats": repeats,
        "order": order,
        "seed": seed,
        "anchor_every": anchor_every,
        "sample_s": sample_s,
        "name": name,
    }
    if resume is not None:
        clash = [option for option, value in given.items() if value is not None]
        if clash or plan is not None:
            option = (clash or ["plan"])[0].replace("_", "-")
            raise InputError(
                f"--{option} and --resume are both given; a resumed run keeps the plan that it has"
            )
        rest = unfinished(Run.open(resume))
        if not rest.left and not dry_run:
            prepare(rest)  # closes it and says that nothing is left
        resolved, stands = rest.plan, rest.rig
        permit = announce_code if address else refuse_code
        address = address or str(rest.run.metadata.get("address", ""))
        stage = stage or rest.stage
    else:
        if not address:
            raise InputError("which bench? name its address, for example sim:pquad")
        rest, permit = None, announce_code
        stands = rig_for(address, rig)
        resolved = with_options(read_plan(plan) if plan else Plan(), given).resolved(stands)
        if out is not None:
            refuse_taken(out)
        check_run_name(resolved.name)
    # Everything that was typed is looked at before anything is printed or opened.
    air = air_of(temperature, pressure, humidity)
    check_stage(stage, stands)
    if calibration not in (None, "none"):
        read_calibration(Path(str(calibration)))
    bench = open_bench(address, permit)
    expected = check_plan(resolved, stands)
    _show_plan(resolved, stands, expected, rest)
    if dry_run:
        print("dry run: nothing was opened, nothing spins")
        return
    folder = (runs, out)
    start = prepare(rest) if rest else None
    _sweep(bench, resolved, stands, rest, start, folder, operator, air, calibration, stage, yes)


def _show_plan(plan: Plan, rig: Rig, expected: Expected, rest: Unfinished | None) -> None:
    from benchtool.acquire.duration import expected_duration_s, minutes
    from benchtool.acquire.order import settings_of, visits_of
    from benchtool.core.counted import counted

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
    device: Bench,
    plan: Plan,
    rig: Rig,
    rest: Unfinished | None,
    start: Start | None,
    folder: tuple[Path, Path | None],
    operator: str,
    air: Air,
    calibration: str | None,
    stage: str | None,
    yes: bool,
) -> None:
    """Open the bench, arm, sweep, and close the run whatever happened."""
    from benchtool.acquire.calibration_file import calibration_for
    from benchtool.acquire.check_plan import check_plan
    from benchtool.acquire.new_run import new_run
    from benchtool.acquire.resume import require_same_device
    from benchtool.acquire.stage_choice import stage_for
    from benchtool.acquire.sweep import run_sweep
    from benchtool.bench.closing_signals import ClosingSignals
    from benchtool.bench.guard import GuardedBench
    from benchtool.cli.closing import close_stopped
    from benchtool.cli.sweep_display import display_for
    from benchtool.cli.sweep_operator import LOOK_S, answer_to, say_of_bench
    from benchtool.core.counted import counted
    from benchtool.store.parquet import load_library

    load_library()
    run: Run | None = None
    measured = False
    with ClosingSignals() as closing:
        try:
            with GuardedBench(device, rig) as bench:
                identity = bench.identity
                say_of_bench(identity, rig)
                expected = check_plan(plan, rig, identity.limits)
                scale = rest.calibration if rest else calibration_for(calibration, identity)
                mover = stage_for(
                    stage, bench, rig, lambda text: answer_to(text, lambda: bench.listen(LOOK_S))
                )
                _arm(bench, plan, rig, expected, scale, yes)
                with bench.interruptible():
                    mover.open()
                try:
                    if rest:
                        require_same_device(rest, identity)
                        run = rest.run
                    else:
                        run = new_run(
                            folder,
                            plan,
                            rig,
                            identity,
                            operator=operator,
                            air=air,
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
    print(
        f"{counted(summary.measured, 'point')}{simulated}, {summary.unsettled} not settled, "
        f"{counted(summary.tares, 'tare')}, {counted(summary.samples, 'sample')}, {summary.lost} "
        f"lost; in {run.path}"
    )


def _arm(
    bench: GuardedBench,
    plan: Plan,
    rig: Rig,
    expected: Expected,
    calibration: Calibration | None,
    yes: bool,
) -> None:
    from datetime import datetime

    from benchtool.acquire.arming import CONFIRMATION, arming_text, require_unattended
    from benchtool.cli.sweep_operator import confirm_arming

    text = arming_text(plan, rig, expected)
    scale = f"calibration {calibration.id}" if calibration else "the device's own newtons"
    text = f"{text}\nthrust by {scale}"
    if yes:
        require_unattended(bench.identity, rig, datetime.now().astimezone().date())
        print(text, flush=True)
    else:
        confirm_arming(text, CONFIRMATION, bench)
