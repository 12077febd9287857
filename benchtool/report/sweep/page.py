"""The report page of a sweep: what was measured, how, and what stands behind it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import hypot, isfinite

import numpy as np

from benchtool import __version__
from benchtool.core.errors import BenchtoolError
from benchtool.core.plural import pluralize
from benchtool.data.calibration import age_text
from benchtool.data.columns import REJECTED
from benchtool.data.run.read import changed_points
from benchtool.fit.motor.constants import fit_motor
from benchtool.report.figure import Page, render_figures
from benchtool.report.fit.budget import budget_blocks
from benchtool.report.motor.page import MOTOR
from benchtool.report.numbers import value_with_sd
from benchtool.report.page import (
    Block,
    FactTable,
    Heading,
    Listing,
    Paragraph,
    Section,
    Table,
    Warnings,
)
from benchtool.report.run_facts import (
    MISSING_VALUE,
    air_facts,
    calibration_facts,
    device_facts,
    rig_facts,
    run_state_table,
    version_facts,
)
from benchtool.report.style import BASES
from benchtool.report.sweep.figures import plain
from benchtool.report.sweep.run import SweepRun
from benchtool.report.sweep.samples import anchor_changes
from benchtool.report.sweep.tables import (
    events_block,
    limits_table,
    quantity_tables,
    settings_table,
    tares_table,
)

NO_SAMPLES = Paragraph("The folder holds no samples, only points made of them.")


def _drift(run: SweepRun) -> list[Block]:
    _, change, error = anchor_changes(run)
    text = "No anchor was repeated, so drift of the load cell was not watched."
    if not run.uses_plate:
        text = "What the load cell showed at rest after each tare:"
    if len(change) > 1:
        worst = int(np.argmax(np.abs(change)))
        moved = value_with_sd(1e3 * float(change[worst]), 1e3 * float(error[worst]))
        text = (
            f"{len(change)} anchors: since the first the load cell moved by at most {moved} mN at "
            f"equal rotor speed."
        )
    elif len(change) == 1:
        text = "One anchor was measured; drift shows from the second on."
    tares = [] if run.tares is None else [tares_table(run.tares)]
    return [Paragraph(text), *tares]


def _conditions(run: SweepRun) -> list[Block]:
    facts = run.metadata
    blocks: list[Block] = [
        FactTable(run_state_table(facts) | air_facts(facts) | calibration_facts(facts))
    ]
    if known := facts.get("calibration"):
        blocks += render_figures(
            "sweep.calibration", {**known, "simulated": run.simulated}
        ).values()
    return blocks


def _data(run: SweepRun) -> Block:
    facts = version_facts(run.metadata)
    facts["reported with"] = f"benchtool {__version__}"
    facts["sha256 of the run's data (points and samples)"] = run.sha256
    return FactTable(facts | {f"sha256 of {name}": digest for name, digest in run.files.items()})


def run_sentence(run: SweepRun) -> str:
    """Say in a few sentences what was measured and what came out."""
    measured, z = run.measured(), run.z_over_R(run.settings)
    levels = np.unique(run.level_us()[measured])
    visits = sum(kind == "measure" for kind in run.kinds)
    if measured.any():
        words = (
            f"{pluralize(visits, 'visit')} of {pluralize(int(measured.sum()), 'setting')} on rig "
            f"{run.rig.name}, plate at z/R {np.nanmin(z[measured]):.3g} to "
            f"{np.nanmax(z[measured]):.3g}, pulses "
            f"{', '.join(f'{level:g}' for level in levels)} µs."
        )
    elif not run.uses_plate:
        pulses = ", ".join(f"{level:g}" for level in np.unique(run.level_us()))
        words = (
            f"{pluralize(len(run.kinds), 'visit')} of "
            f"{pluralize(len(run.settings), 'throttle level')} "
            f"without a plate on rig {run.rig.name}, pulses {pulses} µs."
        )
    else:
        words = f"No setting near the plate was measured on rig {run.rig.name}."
    if (place := _largest(run)) is not None:
        largest = value_with_sd(float(run.ratio[place]), float(run.ratio_error[place]))
        words += f" T_IGE/T_OGE at {BASES[run.basis]} is largest, {largest}, at z/R {z[place]:.3g}."
    state = str(run.metadata.get("state", ""))
    if state == "stopped":
        words += f" The run was stopped: {run.metadata.get('reason')}."
    elif state == "running":
        words += " The run was never closed: it still goes on, or its process was killed."
    return words


def _largest(run: SweepRun) -> int | None:
    near = run.measured() & np.isfinite(run.ratio)
    return int(np.argmax(np.where(near, run.ratio, -np.inf))) if near.any() else None


def _highlights(run: SweepRun) -> dict[str, str]:
    shown = {}
    if (place := _largest(run)) is not None:
        z = run.z_over_R(run.settings)[place]
        shown[f"T_IGE/T_OGE at z/R = {z:.3g}"] = value_with_sd(
            float(run.ratio[place]), float(run.ratio_error[place])
        )
    se = run.points.column("thrust_se_N")
    shown["standard error of a point, median"] = f"{1e3 * np.nanmedian(se):.2g} mN"
    if run.tares is not None:
        worst = float(np.nanmax(np.abs(run.tares.column("thrust_N"))))
        shown["largest rest after a tare"] = f"{1e3 * worst:.2g} mN"
    shown["points not settled"] = f"{_unsettled(run)} of {len(run.points)}"
    return shown


def _unsettled(run: SweepRun) -> int:
    """Return how many points were taken although settling timed out."""
    return int((run.points.column("settled") == 0.0).sum()) if "settled" in run.points else 0


def _outliers(run: SweepRun) -> Iterator[str]:
    """Give how many samples the points leave out, and which points hold outliers all the same."""
    names = [name for name in run.points.names if name.endswith(REJECTED)]
    columns = {name: run.points.column(name) for name in names}
    if total := int(sum(column.sum() for column in columns.values())):
        listed = ", ".join(
            f"{column.sum():.0f} of {name.removesuffix(REJECTED)}"
            for name, column in columns.items()
            if column.any()
        )
        yield f"{pluralize(total, 'outlier')} left out of the means: {listed}."
    if "suspect" in run.points and (count := int(run.points.column("suspect").sum())):
        yield (
            f"{pluralize(count, 'point')} suspect: too many samples lie apart to be outliers, or a "
            f"rotor's vibration reads as thrust; the events below say which."
        )


def run_warnings(run: SweepRun) -> list[str]:
    """Return what a reader must know before using a number."""
    out = []
    state = str(run.metadata.get("state", ""))
    if state == "stopped":
        out.append(f"The run was stopped: {run.metadata.get('reason', 'no reason is stated')}.")
    elif state != "ended":
        out.append("The run was never closed; close it with benchtool sweep --resume.")
    if count := _unsettled(run):
        out.append(f"{pluralize(count, 'point')} taken although thrust or speed had not settled.")
    out += _outliers(run)
    if not (run.metadata.get("air") or {}).get("measured"):
        out.append("Nobody measured the air: its density is that of the standard atmosphere.")
    if not run.metadata.get("calibration") and not run.simulated:
        out.append("No calibration is attached: thrust is what the device sends.")
    if old := age_text(run.metadata):
        out.append(f"{old[0].upper()}{old[1:]}.")
    lost = int((run.metadata.get("link") or {}).get("lost", 0) or 0)
    if lost:
        out.append(f"{pluralize(lost, 'sample')} lost on the link.")
    if run.measured().any() and not np.isfinite(run.ratio[run.measured()]).any():
        out.append("There are no references with the plate parked, so no T_IGE/T_OGE.")
    stated = (run.metadata.get("samples") or {}).get("csv_sha256")
    if stated and run.files.get("samples.csv") not in (None, stated):
        out.append("samples.csv has changed since the run was closed: its hash is another one.")
    out += changed_points(run.path)
    for recording in (run.points, run.samples):
        repairs = recording.provenance.get("repairs", "") if recording is not None else ""
        if repairs:
            out.append(f"Mended while reading: {repairs}.")
    return out


def _motor_sections(run: SweepRun) -> Sequence[Section]:
    """Return thrust curve and motor constants of a run without a plate."""
    if run.measured().any() or "reference" not in run.kinds:
        return []
    try:
        return MOTOR.sections(fit_motor([run.path]))
    except BenchtoolError as error:
        return [Section("Motor constants", [Paragraph(f"None could be fitted: {error}.")])]


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
        (
            "Rig and device",
            [lambda run: FactTable(rig_facts(run.metadata) | device_facts(run.metadata))],
        ),
        ("Conditions and calibration", [_conditions]),
        (
            "Plan",
            [lambda run: Listing("The plan, every number filled in (plan.toml).", run.plan_text)],
        ),
        ("Software and data", [_data]),
    ],
    title="Sweep: {0.name}",
    summary=run_sentence,
    highlights=_highlights,
)

Page("sweep.calibration", [("Calibration", ["calibration"])])


CLEAR = 3.0  # a difference of more than so many of its standard deviations is called one


def common_table(runs: Sequence[SweepRun]) -> tuple[Table, str]:
    """Return the ratios at common settings, and in words their differences from the first run."""
    found = [_by_setting(run) for run in runs]
    common = [place for place in found[0] if all(place in one for one in found[1:])]
    rows, apart, worst = [], 0, (0.0, "")
    for place in common:
        (first, first_error), *others = (one[place] for one in found)
        cells = [f"{place[0]:.3g}", f"{place[1]:g}", value_with_sd(first, first_error)]
        for run, (value, error) in zip(runs[1:], others, strict=True):
            spread = hypot(error, first_error)
            size = abs(value - first) / spread if spread > 0.0 else float("nan")
            cells += [value_with_sd(value, error), f"{size:.1f}" if isfinite(size) else "–"]
            apart += size > CLEAR
            if size > worst[0]:
                worst = (size, f"{run.name} at z/R {place[0]:.3g}, {place[1]:g} µs")
        rows.append(cells)
    header = ["plate z/R", "pulse [µs]", runs[0].name]
    for run in runs[1:]:
        header += [run.name, "apart [sd]"]
    table = Table(
        "T_IGE/T_OGE at the settings that all runs have; apart: difference from the first run over "
        "its standard deviation.",
        header,
        rows,
    )
    if not common:
        return table, "The runs have no setting of the same distance and pulse in common."
    text = (
        f"{apart} of {len(common) * (len(runs) - 1)} ratios at common settings are more than "
        f"{CLEAR:g} standard deviations from the first run's"
    )
    return table, f"{text}, the farthest {worst[1]} ({worst[0]:.1f})." if worst[1] else f"{text}."


def _common(runs: Sequence[SweepRun]) -> Table | None:
    table, _ = common_table(runs)
    return table if table.rows else None


def _by_setting(run: SweepRun) -> dict[tuple[float, float], tuple[float, float]]:
    """Return ratio and error by plate distance z/R and pulse in µs."""
    z, levels = run.z_over_R(run.settings).round(2), run.level_us().round(0)
    return {
        (float(z[row]), float(levels[row])): (float(run.ratio[row]), float(run.ratio_error[row]))
        for row in np.flatnonzero(plain(run) & np.isfinite(run.ratio))
    }


def facts_table(runs: Sequence[SweepRun]) -> Table:
    """Set who measured what, when and in which air side by side."""
    columns = []
    for run in runs:
        air, state = air_facts(run.metadata), run_state_table(run.metadata)
        columns.append(
            {
                "rig": run.rig.name,
                "device": str(run.metadata.get("device_id", MISSING_VALUE)),
                "started": state["started"],
                "state": state["state"],
                "air density": air.get("density", air["air"]),
                "calibration": calibration_facts(run.metadata)["calibration"],
                "visits": str(len(run.points)),
                "sha256 of the data": f"{run.sha256[:16]}…",
            }
        )
    return Table(
        "The runs.",
        ("", *(run.name for run in runs)),
        [(key, *(one[key] for one in columns)) for key in columns[0]],
        text_columns=1 + len(runs),
    )


def _in_full(runs: Sequence[SweepRun]) -> list[Section]:
    """Return a section for each run, whose own sections become parts of it."""
    sections = []
    for run in runs:
        parts: list[Block] = [Paragraph(run_sentence(run))]
        for section in SWEEP.sections(run):
            parts += [Heading(section.title), *section.blocks]
        sections.append(Section(f"The run {run.name}", parts))
    return sections


COMPARED = Page(
    "sweep.compared",
    [("Runs compared", ["ratios", _common, facts_table]), _in_full],
    title=lambda runs: f"Sweeps compared: {', '.join(run.name for run in runs)}",
    summary=lambda runs: common_table(runs)[1],
)
