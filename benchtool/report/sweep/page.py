"""The report page of a sweep: what was measured, how, and what stands behind it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchtool import __version__
from benchtool.core.counted import counted
from benchtool.core.errors import FileFormatError
from benchtool.core.parsed_text import parse_toml
from benchtool.fit.model_band import Believed
from benchtool.fit.swept import Swept
from benchtool.report.numbers import value_with_sd
from benchtool.report.page import (
    Block,
    Commands,
    Facts,
    FigureBlock,
    Listing,
    Paragraph,
    Report,
    Section,
    Warnings,
)
from benchtool.report.sweep.calibration_drawn import calibration_drawn
from benchtool.report.sweep.figures import (
    anchor_changes,
    order_and_drift,
    raw_beside_averaged,
    run_ratio,
    samples_over_time,
    thrust_distance,
)
from benchtool.report.sweep.run_facts import (
    air_facts,
    calibration_facts,
    device_facts,
    rig_facts,
    state_facts,
    version_facts,
)
from benchtool.report.sweep.tables import (
    BASES,
    ERRORS,
    events_block,
    limits_table,
    settings_table,
    tares_table,
)


def swept_page(run: Swept, model: Believed | None, commands: Sequence[str]) -> Report:
    """Return the report page of one run."""
    return Report(
        title=f"Sweep: {run.name}",
        summary=run_sentence(run),
        sections=(*swept_sections(run, model), Section("Made with", [Commands(commands)])),
        simulated=run.simulated,
        made=f"benchtool {__version__}",
        highlights=_highlights(run),
    )


def swept_sections(run: Swept, model: Believed | None) -> list[Section]:
    """Return the sections of one run."""
    named: list[tuple[str, list[Block]]] = [
        ("What was measured", _measured(run, model)),
        ("Raw and averaged", _raw(run)),
        ("Order, drift and tares", _order(run)),
        ("Limits and events", [limits_table(run), events_block(run)]),
        ("Rig and device", [Facts(rig_facts(run.metadata) | device_facts(run.metadata))]),
        ("Conditions and calibration", _conditions(run)),
        ("Plan", [Listing("The plan, every number filled in (plan.toml).", run.plan_text)]),
        ("Software and data", [Facts(data_facts(run))]),
    ]
    return [Section(title, blocks) for title, blocks in named]


def run_sentence(run: Swept) -> str:
    """Say in a few sentences what was measured and what came out."""
    measured, z = run.measured(), run.z_over_R(run.settings)
    levels = np.unique(run.level_us()[measured])
    visits = sum(kind == "measure" for kind in run.kinds)
    words = (
        (
            f"{counted(visits, 'visit')} of {counted(int(measured.sum()), 'setting')} on rig "
            f"{run.rig.name}, plate at z/R {np.nanmin(z[measured]):.3g} to "
            f"{np.nanmax(z[measured]):.3g}, pulses "
            f"{', '.join(f'{level:g}' for level in levels)} µs."
        )
        if measured.any()
        else f"No setting near the plate was measured on rig {run.rig.name}."
    )
    if (place := _largest(run)) is not None:
        words += (
            f" T_IGE/T_OGE at {BASES[run.basis]} is largest, "
            f"{value_with_sd(float(run.ratio[place]), float(run.ratio_error[place]))}, at z/R "
            f"{z[place]:.3g}."
        )
    state = str(run.metadata.get("state", ""))
    reason = run.metadata.get("reason")
    if state == "stopped":
        words += f" The run was stopped: {reason}."
    elif state == "running":
        words += " The run was never closed: it still goes on, or its process was killed."
    return words


def _largest(run: Swept) -> int | None:
    near = run.measured() & np.isfinite(run.ratio)
    return int(np.argmax(np.where(near, run.ratio, -np.inf))) if near.any() else None


def _highlights(run: Swept) -> dict[str, str]:
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
    shown["points not settled"] = f"{unsettled(run)} of {len(run.points)}"
    return shown


def unsettled(run: Swept) -> int:
    """Return how many points were taken although settling timed out."""
    return int((run.points.column("settled") == 0.0).sum()) if "settled" in run.points else 0


def run_warnings(run: Swept) -> list[str]:
    """Return what a reader must know before using a number."""
    out = []
    state = str(run.metadata.get("state", ""))
    if state == "stopped":
        out.append(f"The run was stopped: {run.metadata.get('reason', 'no reason is stated')}.")
    elif state != "ended":
        out.append("The run was never closed; close it with benchtool sweep --resume.")
    if count := unsettled(run):
        out.append(f"{counted(count, 'point')} taken although thrust or speed had not settled.")
    if not (run.metadata.get("air") or {}).get("measured"):
        out.append("Nobody measured the air: its density is that of the standard atmosphere.")
    if not run.metadata.get("calibration") and not run.simulated:
        out.append("No calibration is attached: thrust is what the device sends.")
    lost = int((run.metadata.get("link") or {}).get("lost", 0) or 0)
    if lost:
        out.append(f"{counted(lost, 'sample')} lost on the link.")
    if not np.isfinite(run.ratio[run.measured()]).any():
        out.append("There are no references with the plate parked, so no T_IGE/T_OGE.")
    stated = (run.metadata.get("samples") or {}).get("csv_sha256")
    if stated and run.files.get("samples.csv") not in (None, stated):
        out.append("samples.csv has changed since the run was closed: its hash is another one.")
    for recording in (run.points, run.samples):
        repairs = recording.provenance.get("repairs", "") if recording is not None else ""
        if repairs:
            out.append(f"Mended while reading: {repairs}.")
    return out


def _measured(run: Swept, model: Believed | None) -> list[Block]:
    blocks: list[Block] = [Warnings(run_warnings(run))]
    said = ""
    if model is not None:
        spread = f" Its bands: {model.spread}." if model.spread else " It states no uncertainty."
        fitted = f", fitted to {', '.join(model.fitted_to)}" if model.fitted_to else ""
        said = f" Model: {model.model.name}{fitted}.{spread}"
    if (figure := run_ratio(run, model)) is not None:
        blocks.append(
            FigureBlock(
                figure,
                f"Thrust near the plate over thrust with the plate parked, at "
                f"{BASES[run.basis]}. Bars: {ERRORS}. Dashed: the closed image formulae (PFI) "
                f"at the rig's radius, nothing fitted.{said}",
            )
        )
    if run.measured().any():
        blocks.append(
            FigureBlock(
                thrust_distance(run, model),
                "Thrust against plate distance at each throttle level. Bars as above; dotted: the "
                "level's mean with the plate parked." + said,
            )
        )
    return [*blocks, settings_table(run)]


def _raw(run: Swept) -> list[Block]:
    calibrated = bool(run.metadata.get("calibration"))
    blocks: list[Block] = []
    if (figure := samples_over_time(run)) is not None:
        blocks.append(
            FigureBlock(
                figure,
                "Every sample as the device sent it"
                + (", before the calibration" if calibrated else "")
                + "; shaded: the stretches whose samples became points.",
            )
        )
    if (figure := raw_beside_averaged(run)) is not None:
        blocks.append(
            FigureBlock(
                figure,
                "Raw samples of each visit beside their mean: nothing is filtered but by averaging "
                "over the shaded stretches above. Standard errors count the samples' "
                "autocorrelation (initial positive sequence, Geyer 1992)."
                + (" Raw counts are shown through the calibration's slope." if calibrated else ""),
            )
        )
    if not blocks:
        blocks.append(Paragraph("The folder holds no samples, only points made of them."))
    return blocks


def _order(run: Swept) -> list[Block]:
    residual_N = _residual_N(run.plan_text)
    _, change, error = anchor_changes(run)
    said = "No anchor was repeated, so drift of the load cell was not watched."
    if len(change) > 1:
        worst = int(np.argmax(np.abs(change)))
        said = (
            f"{len(change)} anchors: since the first the load cell moved by at most "
            f"{value_with_sd(1e3 * float(change[worst]), 1e3 * float(error[worst]))} mN at equal "
            f"rotor speed."
        )
    elif len(change) == 1:
        said = "One anchor was measured; drift shows from the second on."
    blocks: list[Block] = [
        FigureBlock(
            order_and_drift(run, residual_N),
            "Above: plate distances in the order of measurement. Below: change of thrust at the "
            "anchors, brought to the first anchor's rotor speed, and what the load cell showed "
            "after each tare.",
        ),
        Paragraph(said),
    ]
    if run.tares is not None:
        blocks.append(tares_table(run.tares))
    return blocks


def _residual_N(plan_text: str) -> float:
    try:
        return float(parse_toml(plan_text, "plan.toml")["tare"]["residual_N"])
    except (FileFormatError, KeyError, TypeError, ValueError):
        return float("nan")


def _conditions(run: Swept) -> list[Block]:
    facts = run.metadata
    blocks: list[Block] = [Facts(state_facts(facts) | air_facts(facts) | calibration_facts(facts))]
    if known := facts.get("calibration"):
        blocks.append(
            FigureBlock(
                calibration_drawn(known, simulated=run.simulated),
                "The calibration. Above: mean raw reading of each known mass and the line. Below: "
                "what the line leaves over; a gap between the two ways is hysteresis, an arch a "
                "bent line.",
            )
        )
    return blocks


def data_facts(run: Swept) -> dict[str, str]:
    """Return the software, and the hashes that tie the page to its data."""
    facts = version_facts(run.metadata)
    facts["reported with"] = f"benchtool {__version__}"
    facts["sha256 of the run's data (points and samples)"] = run.sha256
    return facts | {f"sha256 of {name}": digest for name, digest in run.files.items()}
