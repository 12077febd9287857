"""Command `benchtool calibrate`: load cell calibration from known masses."""

from __future__ import annotations

from dataclasses import dataclass, field
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

from annotated_types import Ge, Gt, Le

from benchtool.acquire.inputs import WeighingInputs
from benchtool.commands.input_commands import command_from_inputs
from benchtool.commands.terminal.messages import announce_code
from benchtool.core.errors import CalibrationError, InputError, MissingColumn
from benchtool.core.inputs import Input, Inputs, items

if TYPE_CHECKING:
    from benchtool.core.units import Array
    from benchtool.data.calibration import Calibration

FIGURES: Final = ("svg", "png")
APPLY_OPTIONS: Final = ("--apply", "--calibration", "--other-device")

MAX_AVERAGE_S = 600.0  # per mass; above it drift outweighs noise; assumed


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrateInputs(Inputs):
    """Options of `benchtool calibrate`."""

    address: Annotated[str, Input("Bench; not with --from.", argument="ADDRESS")] = ""
    masses: Annotated[
        tuple[Annotated[float, Ge(0.0), Le(1e4)], ...],
        Input("Masses in order, up and down: 0,0.2,0.5,0.", "kg"),
    ] = ()
    source: Annotated[
        Path | None,
        Input("CSV with columns mass_kg, thrust_raw, and day for several.", option="from"),
    ] = None
    device_id: Annotated[str, Input("Device of the CSV.")] = ""
    rig: Annotated[str | None, Input("Rig name or file.")] = None
    weighing: WeighingInputs = field(default_factory=WeighingInputs)
    add: Annotated[Path | None, Input("Earlier calibration to include.")] = None
    seconds: Annotated[
        float, Gt(0.0), Le(MAX_AVERAGE_S), Input("Averaging time per mass.", "s")
    ] = 3.0
    out: Annotated[
        Path | None, Input("Also write the calibration and its figure to this new file.")
    ] = None
    apply: Annotated[Path | None, Input("Run folder to recalibrate.", group="Apply to a run")] = (
        None
    )
    calibration: Annotated[
        Path | None, Input("Calibration file for --apply.", default_text="latest of the device")
    ] = None
    other_device: Annotated[
        bool, Input("Accept a calibration of another device; recorded in the run.")
    ] = False


@command_from_inputs(CalibrateInputs)
def calibrate(inputs: CalibrateInputs) -> None:
    """Calibrate a load cell, or apply a calibration to a run.

    The calibration is stored and used by all later runs of that device. With --apply, no bench
    is opened and the raw data of the run do not change.
    """
    changed = [item for item in items(type(inputs)) if attrgetter(item.key)(inputs) != item.default]
    options = [item.option for item in changed]
    others = [option for option in options if option not in APPLY_OPTIONS]
    if inputs.apply is None:
        if len(others) < len(options):
            raise InputError("--calibration and --other-device need a run; add --apply RUN")
        _calibrate(inputs)
    elif others:
        raise InputError(f"--apply excludes {', '.join(others)}; remove one of them")
    else:
        _apply_to_run(inputs.apply, inputs.calibration, inputs.other_device)


def _apply_to_run(path: Path, file: Path | None, other_device: bool) -> None:
    from benchtool.acquire.calibration import recalibrate
    from benchtool.data.calibration import parse_calibration, read_calibration
    from benchtool.data.run.run import Run
    from benchtool.data.run.state import load_state

    run = Run.open(path)
    if file is not None:
        calibration = read_calibration(file)
    else:
        device_id = str(run.metadata.get("device_id", ""))
        if (latest := load_state("calibration", device_id)) is None:
            raise CalibrationError(
                f"no stored calibration for device {device_id!r}; add --calibration FILE"
            )
        calibration = parse_calibration(latest, f"the latest calibration of {device_id}")
    folder = recalibrate(run, calibration, other_device=other_device)
    print(f"points with calibration {calibration.id}: {folder}")


def _calibrate(inputs: CalibrateInputs) -> None:
    if (inputs.source is None) == (not inputs.masses):
        raise InputError("give exactly one of --masses and --from CSV")
    from dataclasses import asdict

    from benchtool.acquire.calibration import (
        current_date,
        fit_calibration,
        require_device,
        with_drift_interval,
    )
    from benchtool.data.atomic import replace_json
    from benchtool.data.calibration import read_calibration
    from benchtool.data.run.state import store_state
    from benchtool.report.figure import check_not_existing, save_figure

    source, out, device_id = inputs.source, inputs.out, inputs.device_id
    if out is not None:
        check_not_existing([out, *(out.with_suffix(f".{kind}") for kind in FIGURES)])
    earlier = None if inputs.add is None else read_calibration(inputs.add)
    date, weighing = current_date(), inputs.weighing
    if source is not None:
        kilograms, counts, days = _from_csv(source)
        if not device_id:
            raise InputError(
                "device of the counts is missing; add --device-id (benchtool ports --probe or "
                "metadata.json of a run shows it)"
            )
    else:
        if not inputs.address:
            raise InputError("bench address is missing; add it before --masses")
        kilograms, counts, device_id = _from_bench(inputs)
        days = []
    if earlier is not None:
        require_device(earlier, str(inputs.add), "the bench", device_id, "its own readings")
        if len(set(days)) > 1:
            raise InputError("--add needs readings of one day, but --from contains several days")
        kilograms, counts, days = with_drift_interval(
            earlier, kilograms, counts, date[:10], weighing
        )
    calibration = fit_calibration(
        kilograms, counts, date=date, device_id=device_id, weighing=weighing, days=days
    )
    _print_calibration(calibration)
    data = asdict(calibration)
    stored = store_state("calibration", device_id, data)
    if out is not None:
        from benchtool.report.figure import render_figures

        replace_json(out, data)
        subject = {**data, "simulated": inputs.address.startswith("sim:")}
        figure = render_figures("sweep.calibration", subject)["calibration"].figure
        for path in save_figure(figure, out.with_suffix(""), FIGURES):
            print(f"written: {path}")
    print(f"stored in {out or stored}; every run on {device_id} uses it from now on")


def _from_csv(source: Path) -> tuple[Array, Array, list[str]]:
    from benchtool.data.table import read_table

    names = {name: name for name in ("mass_kg", "thrust_raw", "day")}
    try:
        table = read_table(source, names)
    except MissingColumn:
        table = read_table(source, {name: name for name in names if name != "day"})
    days = [f"{day:.15g}" for day in table.column("day")] if "day" in table else []
    return table.column("mass_kg"), table.column("thrust_raw"), days


def _from_bench(inputs: CalibrateInputs) -> tuple[Array, Array, str]:
    import numpy as np

    from benchtool.acquire.calibration import mean_counts, require_raw_counts
    from benchtool.acquire.inputs import resolve_rig
    from benchtool.acquire.operator import POLL_INTERVAL_S
    from benchtool.bench.drivers import open_bench
    from benchtool.commands.terminal.operator import TERMINAL
    from benchtool.core.units import STANDARD_GRAVITY_M_S2

    address, kilograms = inputs.address, np.array(inputs.masses)
    counts = []
    rating_N = resolve_rig(address, inputs.rig).limits.load_cell_rating_N
    max_N = float(kilograms.max()) * STANDARD_GRAVITY_M_S2
    if max_N > rating_N:
        raise InputError(
            f"mass {kilograms.max():g} kg ({max_N:.3g} N) is out of range; allowed: up to the "
            f"load cell rating of {rating_N:g} N; use smaller masses"
        )
    # Without the guard of a sweep, which rejects thrust at standstill.
    with open_bench(address, announce_code) as bench:
        require_raw_counts(bench)
        is_virtual = address.startswith("sim:")
        for kilogram in kilograms:
            question = f"hang {kilogram:g} kg, wait until it is still, then press Enter: "
            TERMINAL.answer(question, None if is_virtual else lambda: bench.read(POLL_INTERVAL_S))
            average = mean_counts(bench, inputs.seconds)
            print(f"  {average.mean:.1f} counts, +- {average.se:.1f}")
            counts.append(average.mean)
        device_id = bench.identity.device_id
    return kilograms, np.array(counts), device_id


def _print_calibration(calibration: Calibration) -> None:
    c = calibration
    print(
        f"slope {c.slope_N_per_count:.6g} N per count, standard uncertainty "
        f"{100.0 * c.relative_sd:.2g} % on {c.dof:.3g} degrees of freedom; 95 %: +- "
        f"{100.0 * c.relative_half_width(0.95):.2g} %"
    )
    for component in c.components:
        dof = "" if component.dof is None else f", {component.dof:g} degrees of freedom"
        unit = "" if component.unit == "1" else f" {component.unit}"
        print(
            f"  {component.name} (type {component.kind}): {component.sd:.3g}{unit} contributes "
            f"{100.0 * component.relative_sd:.2g} %{dof}"
        )
    hysteresis = "unknown, masses in one direction only"
    if c.hysteresis is not None:
        hysteresis = f"{100.0 * c.hysteresis:.3f} % of full scale"
    print(f"nonlinearity {100.0 * c.straightness:.3f} % of full scale, hysteresis {hysteresis}")
    for kilogram, count, residual_N in zip(c.masses_kg, c.counts, c.residuals_N, strict=True):
        print(f"  {kilogram:8.4f} kg  {count:14.1f}  {1000.0 * residual_N:+8.2f} mN")
