"""Report page of a sweep: results, quantities, samples, drift, budget, conditions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain
from math import hypot, isfinite

import numpy as np

from benchtool.core.errors import BenchtoolError
from benchtool.core.text import pluralize
from benchtool.data.calibration import format_age_warning
from benchtool.data.columns import REJECTED
from benchtool.data.run.read import changed_points
from benchtool.fit.motor.constants import fit_motor
from benchtool.report.figure import render_figures
from benchtool.report.fit.budget import budget_blocks
from benchtool.report.motor import MOTOR
from benchtool.report.numbers import value_with_sd
from benchtool.report.page import Block, Heading, Listing, Page, Section, Table, Warnings
from benchtool.report.ratio import BASES
from benchtool.report.run_facts import (
    MISSING_VALUE,
    air_facts,
    bench_facts,
    calibration_facts,
    condition_facts,
    data_facts,
    run_state_table,
)
from benchtool.report.sweep.figures import plain
from benchtool.report.sweep.run import (
    SweepRun,
    events_block,
    limits_table,
    quantity_tables,
    settings_table,
    tares_table,
)
from benchtool.report.sweep.samples import anchor_changes

NO_SAMPLES = "The folder contains no samples, only points averaged from them."


def _drift(run: SweepRun) -> list[Block]:
    _, change, error = anchor_changes(run)
    text = "Load cell reading at standstill after each tare:"
    if run.uses_plate:
        text = "No anchor was repeated, so load cell drift is unknown."
    if len(change) > 1:
        worst = int(np.argmax(np.abs(change)))
        drift_text = value_with_sd(1e3 * float(change[worst]), 1e3 * float(error[worst]))
        text = (
            f"{len(change)} anchors: maximum load cell drift since the first is {drift_text} mN "
            f"at equal rotor speed."
        )
    elif len(change) == 1:
        text = "One anchor was measured; drift needs at least two."
    tares = [] if run.tares is None else [tares_table(run.tares)]
    return [text, *tares]


def _conditions(run: SweepRun) -> list[Block]:
    blocks: list[Block] = [condition_facts(run.metadata)]
    if calibration := run.metadata.get("calibration"):
        blocks += render_figures(
            "sweep.calibration", {**calibration, "simulated": run.simulated}
        ).values()
    return blocks


def run_sentence(run: SweepRun) -> str:
    """Return a summary of settings, results and state of a run in a few sentences."""
    measured, z, levels = run.measured(), run.z_over_R(run.settings), run.level_us()
    levels = np.unique(levels[measured] if measured.any() else levels)
    pulses = ", ".join(f"{level:g}" for level in levels)
    if measured.any():
        text = (
            f"{pluralize(run.kinds.count('measure'), 'point')} of "
            f"{pluralize(int(measured.sum()), 'setting')} on rig {run.rig.name}, plate at z/R "
            f"{np.nanmin(z[measured]):.3g} to {np.nanmax(z[measured]):.3g}, pulses {pulses} µs."
        )
    elif not run.uses_plate:
        text = (
            f"{pluralize(len(run.kinds), 'point')} of "
            f"{pluralize(len(run.settings), 'throttle level')} "
            f"without a plate on rig {run.rig.name}, pulses {pulses} µs."
        )
    else:
        text = f"No setting near the plate was measured on rig {run.rig.name}."
    if (row := _largest(run)) is not None:
        largest = value_with_sd(float(run.ratio[row]), float(run.ratio_error[row]))
        text += f" T_IGE/T_OGE at {BASES[run.basis]} is largest, {largest}, at z/R {z[row]:.3g}."
    state = str(run.metadata.get("state", ""))
    if state == "stopped":
        text += f" The run was stopped: {run.metadata.get('reason')}."
    elif state == "running":
        text += " The run was not closed: it is still running, or its process was killed."
    return text


def _largest(run: SweepRun) -> int | None:
    near = run.measured() & np.isfinite(run.ratio)
    return int(np.argmax(np.where(near, run.ratio, -np.inf))) if near.any() else None


def _highlights(run: SweepRun) -> dict[str, str]:
    tiles = {}
    if (row := _largest(run)) is not None:
        name = f"T_IGE/T_OGE at z/R = {run.z_over_R(run.settings)[row]:.3g}"
        tiles[name] = value_with_sd(float(run.ratio[row]), float(run.ratio_error[row]))
    se = run.points.column("thrust_se_N")
    tiles["standard error of a point, median"] = f"{1e3 * np.nanmedian(se):.2g} mN"
    if run.tares is not None:
        worst = float(np.nanmax(np.abs(run.tares.column("thrust_N"))))
        tiles["largest offset after a tare"] = f"{1e3 * worst:.2g} mN"
    tiles["points not settled"] = f"{_unsettled(run)} of {len(run.points)}"
    return tiles


def _unsettled(run: SweepRun) -> int:
    """Return the number of points measured after a settling timeout."""
    return int((run.points.column("settled") == 0.0).sum()) if "settled" in run.points else 0


def _outliers(run: SweepRun) -> Iterator[str]:
    """Yield warnings on rejected outliers and suspect points."""
    names = [name for name in run.points.names if name.endswith(REJECTED)]
    columns = {name: run.points.column(name) for name in names}
    if total := int(sum(column.sum() for column in columns.values())):
        listed = ", ".join(
            f"{column.sum():.0f} of {name.removesuffix(REJECTED)}"
            for name, column in columns.items()
            if column.any()
        )
        yield f"{pluralize(total, 'outlier')} excluded from the means: {listed}."
    if "suspect" in run.points and (count := int(run.points.column("suspect").sum())):
        yield (
            f"{pluralize(count, 'point')} suspect: too many deviating samples to be outliers, or "
            f"rotor vibration in the thrust channel; see the events below."
        )


def run_warnings(run: SweepRun) -> list[str]:
    """Return the warnings to read before using a number."""
    warnings = []
    state = str(run.metadata.get("state", ""))
    if state == "stopped":
        warnings.append(
            f"The run was stopped: {run.metadata.get('reason', 'no reason is stated')}."
        )
    elif state != "ended":
        warnings.append("The run was not closed; close it with benchtool sweep --resume.")
    if count := _unsettled(run):
        warnings.append(
            f"{pluralize(count, 'point')} measured although thrust or speed had not settled."
        )
    warnings += _outliers(run)
    if not (run.metadata.get("air") or {}).get("measured"):
        warnings.append("Air was not measured: the density is that of the standard atmosphere.")
    if not run.metadata.get("calibration") and not run.simulated:
        warnings.append("No calibration is attached: thrust is the device value.")
    if old := format_age_warning(run.metadata):
        warnings.append(f"{old[0].upper()}{old[1:]}.")
    if lost := int((run.metadata.get("link") or {}).get("lost", 0) or 0):
        warnings.append(f"{pluralize(lost, 'sample')} lost on the link.")
    if run.measured().any() and not np.isfinite(run.ratio[run.measured()]).any():
        warnings.append("No references with the plate parked, required for T_IGE/T_OGE.")
    stored_hash = (run.metadata.get("samples") or {}).get("csv_sha256")
    if stored_hash and run.files.get("samples.csv") not in (None, stored_hash):
        warnings.append("samples.csv has changed since the run was closed: its hash differs.")
    warnings += changed_points(run.path)
    for recording in (run.points, run.samples):
        if recording is not None and (repairs := recording.provenance.get("repairs")):
            warnings.append(f"Repaired while reading: {repairs}.")
    return warnings


def _motor_sections(run: SweepRun) -> Sequence[Section]:
    """Return sections on the motor constants of a run without a plate."""
    if run.measured().any() or "reference" not in run.kinds:
        return []
    try:
        return MOTOR.sections(fit_motor([run.path]))
    except BenchtoolError as error:
        return [Section("Motor constants", [f"The fit failed: {error}."])]


SWEEP = Page(
    "sweep",
    [
        (
            "What was measured",
            [
                lambda run: Warnings(run_warnings(run)),
                "ratio",
                "distance",
                "efficiency",
                settings_table,
            ],
        ),
        _motor_sections,
        ("Quantities", ["quantities", quantity_tables]),
        (
            "Raw and averaged",
            ["samples", "visits", lambda run: NO_SAMPLES if run.samples is None else None],
        ),
        ("Order, drift and tares", ["order", _drift]),
        ("Uncertainty budget", [lambda run: budget_blocks(run.budget), "budget"]),
        ("Limits and events", [limits_table, events_block]),
        ("Rig and device", [lambda run: bench_facts(run.metadata)]),
        ("Conditions and calibration", [_conditions]),
        (
            "Plan",
            [lambda run: Listing("Plan with all defaults resolved (plan.toml).", run.plan_text)],
        ),
        ("Software and data", [lambda run: data_facts(run.metadata, run.sha256, run.files)]),
    ],
    title="Sweep: {0.name}",
    summary=run_sentence,
    highlights=_highlights,
)

Page("sweep.calibration", [("Calibration", ["calibration"])])


MIN_SIGNIFICANCE = 3.0  # standard deviations of a significant difference; assumed


def common_table(runs: Sequence[SweepRun]) -> tuple[Table | None, str]:
    """Return a table of ratios at common settings, and a sentence on their differences."""
    ratios = [_by_setting(run) for run in runs]
    common = [setting for setting in ratios[0] if all(setting in other for other in ratios[1:])]
    if not common:
        return None, "The runs have no common setting of distance and pulse width."
    rows, n_significant, worst = [], 0, (0.0, "")
    for setting in common:
        (first, first_error), *others = (ratio[setting] for ratio in ratios)
        z_over_R, pulse_us = setting
        cells = [f"{z_over_R:.3g}", f"{pulse_us:g}", value_with_sd(first, first_error)]
        for run, (value, error) in zip(runs[1:], others, strict=True):
            sd = hypot(error, first_error)
            size = abs(value - first) / sd if sd > 0.0 else float("nan")
            cells += [value_with_sd(value, error), f"{size:.1f}" if isfinite(size) else "–"]
            n_significant += size > MIN_SIGNIFICANCE
            if size > worst[0]:
                worst = (size, f"{run.name} at z/R {z_over_R:.3g}, {pulse_us:g} µs")
        rows.append(cells)
    header = ["plate z/R", "pulse [µs]", runs[0].name]
    for run in runs[1:]:
        header += [run.name, "difference [sd]"]
    table = Table(
        "T_IGE/T_OGE at common settings; difference: from the first run, over its standard "
        "deviation.",
        header,
        rows,
    )
    text = (
        f"{n_significant} of {len(common) * (len(runs) - 1)} ratios at common settings differ from "
        f"the first run by more than {MIN_SIGNIFICANCE:g} standard deviations"
    )
    return table, f"{text}; largest: {worst[1]} ({worst[0]:.1f})." if worst[1] else f"{text}."


def _by_setting(run: SweepRun) -> dict[tuple[float, float], tuple[float, float]]:
    """Return ratio and error by plate distance z/R and pulse width in µs."""
    z, levels = run.z_over_R(run.settings).round(2), run.level_us().round(0)
    return {
        (float(z[row]), float(levels[row])): (float(run.ratio[row]), float(run.ratio_error[row]))
        for row in np.flatnonzero(plain(run) & np.isfinite(run.ratio))
    }


def facts_table(runs: Sequence[SweepRun]) -> Table:
    """Return a table of runs: rig, device, time, state, air, calibration, hash."""
    facts = [run.metadata for run in runs]
    states, airs = [*map(run_state_table, facts)], [*map(air_facts, facts)]
    rows = [
        ("rig", *(run.rig.name for run in runs)),
        ("device", *(str(metadata.get("device_id", MISSING_VALUE)) for metadata in facts)),
        ("started", *(state["started"] for state in states)),
        ("state", *(state["state"] for state in states)),
        ("air density", *(air.get("density", air["air"]) for air in airs)),
        ("calibration", *(calibration_facts(metadata)["calibration"] for metadata in facts)),
        ("points", *(str(len(run.points)) for run in runs)),
        ("sha256 of the data", *(f"{run.sha256[:16]}…" for run in runs)),
    ]
    return Table("The runs.", ("", *(run.name for run in runs)), rows, text_columns=1 + len(runs))


def _in_full(runs: Sequence[SweepRun]) -> list[Section]:
    """Return one section per run, with the run's sections as parts."""
    sections = []
    for run in runs:
        parts = [(Heading(part.title), *part.blocks) for part in SWEEP.sections(run)]
        sections.append(Section(f"The run {run.name}", [run_sentence(run), *chain(*parts)]))
    return sections


COMPARED = Page(
    "sweep.compared",
    [("Runs compared", ["ratios", lambda runs: common_table(runs)[0], facts_table]), _in_full],
    title=lambda runs: f"Sweeps compared: {', '.join(run.name for run in runs)}",
    summary=lambda runs: common_table(runs)[1],
)
