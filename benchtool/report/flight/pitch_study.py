"""Pitch bench simulations under several controllers: table, recordings, figure."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from benchtool import __version__
from benchtool.core.recording import Recording
from benchtool.core.text import pluralize
from benchtool.data.run.recording_file import metadata_path, write_recording
from benchtool.report.figure import check_not_existing, figure, render_figures, save_figures
from benchtool.report.numbers import align_columns
from benchtool.report.page import Page
from benchtool.report.palette import BLUE, GREY, VERMILION
from benchtool.report.panels import legend_below, shade, spans, stack_panels
from benchtool.simulate.controllers.controller import make_controller
from benchtool.simulate.gain_file import gain_names, load_gains
from benchtool.simulate.loop import results_in_order
from benchtool.simulate.pitch.run import PitchJob
from benchtool.simulate.pitch.setup import PitchSetup
from benchtool.simulate.pitch.simulate import (
    PitchRun,
    measure_plate_visit,
    simulate_controller,
    simulate_pitch,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PitchStudy:
    """Runs of all controllers with the plate, and without it (`away`)."""

    setup: PitchSetup
    runs: tuple[PitchRun, ...]
    away: tuple[PitchRun, ...]
    seed: int
    simulated: ClassVar = True


def pitch_study(
    setup: PitchSetup,
    seed: int = 0,
    user_controllers: Sequence[tuple[str, type[Any]]] = (),  # a new instance per run
    only_user_controllers: bool = False,
) -> PitchStudy:
    """Simulate all controllers with and without the plate, with the same noise."""
    radius_m = setup.bench.model.rig.propulsion.radius_m
    rate_Hz = setup.rate_Hz
    near = setup.schedule.sampled(rate_Hz, radius_m)
    far = replace(setup.schedule, plate=()).sampled(rate_Hz, radius_m)
    controls = () if only_user_controllers else setup.controls
    jobs = [PitchJob(setup.bench, control) for control in controls]
    results = list(
        results_in_order(
            partial(simulate_pitch, job, schedule, seed) for schedule in (near, far) for job in jobs
        )
    )
    runs, away = results[: len(jobs)], results[len(jobs) :]
    for name, kind in user_controllers:
        job = PitchJob(setup.bench, setup.controls[0])
        for schedule, runs_of_schedule in zip((near, far), (runs, away), strict=True):
            run = simulate_controller(make_controller(kind, name), job, schedule, seed, name=name)
            runs_of_schedule.append(run)
    return PitchStudy(setup=setup, runs=tuple(runs), away=tuple(away), seed=seed)


def visit_rows(study: PitchStudy) -> list[dict[str, Any]]:
    """Return the measures as one row per controller and plate interval."""
    schedule = study.setup.schedule
    return [
        {"controller": run.controller, "z_over_R": visit.z_over_R}
        | asdict(measure_plate_visit(run, visit, schedule.duration_s))
        for run in study.runs
        for visit in schedule.plate
        if visit.in_s < schedule.duration_s
    ]


def table_lines(study: PitchStudy) -> list[str]:
    """Return one line per controller and plate interval, or RMS errors without a plate."""
    visits = visit_rows(study)
    if not visits:
        rows = [("controller", "RMS error [deg]", "largest [deg]")]
        for run in study.runs:
            error = np.degrees(run.column("true_theta_rad") - run.column("reference_rad"))
            rms, largest = np.sqrt(np.mean(error**2)), np.max(np.abs(error))
            rows.append((run.controller, f"{rms:.2f}", f"{largest:.2f}"))
        return align_columns(rows, left=(0,))
    width = max(len("controller"), *(len(run.controller) for run in study.runs))
    lines = [
        f"{'controller':<{width}}   z/R  quiet RMS    peak  settling  residual  rebound",
        f"{'':<{width}}              [deg]   [deg]       [s]     [deg]    [deg]",
    ]
    for row in visits:
        settling = "noise" if np.isnan(row["settling_s"]) else f"{row['settling_s']:.1f}"
        lines.append(
            f"{row['controller']:<{width}}  {row['z_over_R']:>4g}  "
            f"{np.degrees(row['quiet_rms_rad']):>9.2f}  {np.degrees(row['peak_rad']):>6.2f}  "
            f"{settling:>8}  {np.degrees(row['residual_rad']):>8.2f}  "
            f"{np.degrees(row['rebound_rad']):>7.2f}"
        )
    return lines


def warnings_of(study: PitchStudy) -> list[str]:
    """Return warnings on clamped heights and reached end stops."""
    warnings, nearest = [], study.setup.bench.model.nearest_z_over_R
    for run in study.runs:
        if run.clamped_steps:
            warnings.append(
                f"{run.controller}: a rotor was below z/R = {nearest:g} in "
                f"{pluralize(run.clamped_steps, 'step')}; its height was clipped to this limit of "
                f"the formulae"
            )
        if run.stopped_steps:
            steps = pluralize(run.stopped_steps, "step")
            warnings.append(f"{run.controller}: the hinge was at its end stop in {steps}")
    return warnings


def report_lines(study: PitchStudy) -> list[str]:
    """Return the text report of a study: setup, table, warnings."""
    setup, gains = study.setup, study.setup.controls[0].gains
    head = (
        f"SIMULATED pitch bench {setup.bench.model.rig.name}, model {setup.bench.model.name}, "
        f"gains {gains.name if gains else 'none'}, schedule {setup.schedule.name}, "
        f"seed {study.seed}"
    )
    return [head, *table_lines(study), *warnings_of(study)]


def write_study(study: PitchStudy, out: Path) -> list[Path]:
    """Write recordings, text report and figure to new files; return their paths."""
    setup = study.setup
    rig = setup.bench.model.rig
    gains = {  # names of sets whose values are unchanged
        control.name: control.gains.name
        for control in setup.controls
        if control.gains is not None and control.gains.name in gain_names()
        if control.gains == load_gains(control.gains.name)
    }
    recordings = {}
    for run in study.runs:
        provenance = {
            "device": f"simulated pitch bench {rig.name}",
            "model": setup.bench.model.name,
            "controller": run.controller,
            "gains": gains.get(run.controller, ""),
            "schedule": setup.schedule.name,
            "seed": str(study.seed),
        }
        name = re.sub("[:+]", "-", run.controller)
        recordings[name] = run.recording(rig, provenance), {"rig": asdict(rig)}
    return write_simulation(out, PITCH, study, recordings, report_lines(study))


def write_simulation(
    out: Path,
    page: Page,
    subject: Any,
    recordings: Mapping[str, tuple[Recording, Mapping[str, Any]]],  # and facts, by file name
    lines: Sequence[str],
) -> list[Path]:
    """Write recordings, text report and figures to new files; return their paths."""
    tables = {out / f"{name}.csv": recording for name, recording in recordings.items()}
    text = out / "numbers.txt"
    figures = [out / f"{name}.{kind}" for name in page.figures for kind in ("svg", "png")]
    check_not_existing([*tables, *map(metadata_path, tables), text, *figures])
    out.mkdir(parents=True, exist_ok=True)
    for path, (recording, facts) in tables.items():
        write_recording(path, recording, {"software": f"benchtool {__version__}", **facts})
    text.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return [*tables, text, *save_figures(render_figures(page.name, subject), out)]


@figure(
    page="flight.pitch",
    title="{0.setup.bench.model.rig.name}: {0.setup.schedule.title}",
    caption="Pitch under each controller, with and without the plate; green: rotor over the plate.",
    height_in=lambda study: 1.0 + 1.55 * len(study.runs),
)
def pitch(figure: Figure, study: PitchStudy) -> None:
    """Draw one panel per run with common axes, as in figures 26 to 28 of the paper."""
    n_runs, has_plate = len(study.runs), bool(study.setup.schedule.plate)
    xlabel = f"time [s]{'    (green: rotor over the plate)' * has_plate}"
    labels = ["pitch [deg]\n(nose down +)"] * n_runs
    panels = stack_panels(figure, [1.0] * n_runs, labels, xlabel, sharey=True)
    for axes, run, away in zip(panels, study.runs, study.away, strict=True):
        shade(axes, spans(run.time_s, run.column("plate_share") > 0.0), "over-plate")
        lines: list[tuple[PitchRun, str, str, dict[str, Any]]] = [
            (run, "reference_rad", "reference", {"color": GREY, "lw": 1.0, "ls": "--"}),
            (away, "true_theta_rad", "plate away (OGE)", {"color": BLUE, "lw": 0.9}),
            (run, "true_theta_rad", "with the plate (IGE)", {"color": VERMILION, "lw": 1.2}),
        ]
        if not has_plate:
            lines[1:] = [(run, "true_theta_rad", "pitch", {"color": VERMILION, "lw": 1.2})]
        for source, column, label, style in lines:
            axes.plot(run.time_s, np.degrees(source.column(column)), label=label, **style)
        axes.set_title(run.controller)
    panels[0].set_xlim(float(run.time_s[0]), float(run.time_s[-1]))
    legend_below(figure, panels[:1], 3)


PITCH = Page(
    "flight.pitch",
    [("The pitch bench", ["pitch"])],
    title="Simulated pitch bench",
    summary=lambda study: report_lines(study)[0],
)
