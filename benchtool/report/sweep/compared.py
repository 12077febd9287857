"""Several sweeps on one page: ratios over each other, where they differ, then each in full."""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot, isfinite

import numpy as np

from benchtool.report.figure import Page
from benchtool.report.numbers import value_with_sd
from benchtool.report.page import Block, Heading, Paragraph, Section, Table
from benchtool.report.run_facts import MISSING, air_facts, calibration_facts, state_facts
from benchtool.report.sweep.figures import plain
from benchtool.report.sweep.page import SWEEP, run_sentence
from benchtool.report.sweep.run import SweepRun

CLEAR = 3.0
"""A difference of more than so many of its standard deviations is called one."""


def common_table(runs: Sequence[SweepRun]) -> tuple[Table, str]:
    """Return the ratios at settings that every run has, and what they say in a sentence.

    Differences are those of each run from the first.
    """
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
        air, state = air_facts(run.metadata), state_facts(run.metadata)
        columns.append(
            {
                "rig": run.rig.name,
                "device": str(run.metadata.get("device_id", MISSING)),
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
