"""A campaign on the terminal: what is run, progress, how fast it went, and the files."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.progress import MofNCompleteColumn, TimeRemainingColumn

from benchtool import __version__
from benchtool.commands.terminal.messages import announce_code
from benchtool.commands.terminal.tables import progress_bar
from benchtool.core.counted import counted
from benchtool.core.errors import InputError, WouldOverwrite
from benchtool.core.input_text import words_of
from benchtool.report.figure import drawn as drawn_figures
from benchtool.report.files import refuse_existing, save_figure
from benchtool.report.flight.campaign import campaign_map
from benchtool.simulate.campaign import measure_named
from benchtool.simulate.campaign_run import campaign_of, finished_runs, run_campaign
from benchtool.simulate.design import Design
from benchtool.simulate.flight.inputs import FlightInputs
from benchtool.simulate.pitch.inputs import PitchInputs


def run_with_progress(inputs: PitchInputs | FlightInputs, **names: Any) -> None:
    """Run a campaign, show how far it is, write its table and its map."""
    campaign = campaign_of(inputs, announce_code)
    study, several, out = inputs.study, inputs.study.campaign, inputs.study.out
    design = Design.read(
        several.vary, samples=several.samples, seeds=several.seeds, seed=study.seed, **names
    )
    drawn = measure_named(campaign, several.measure)
    if out is None:
        raise InputError("a campaign writes its results to disk; add --out FOLDER")
    table = out / "campaign.parquet"
    if out.exists() and not out.is_dir():
        raise WouldOverwrite(str(out))
    refuse_existing([table, out / "campaign.svg", out / "campaign.png"])
    campaign.check(design)
    series = len(campaign.setups) * len(campaign.controllers)
    total = design.n_points * design.seeds * series
    print(
        f"SIMULATED campaign: {campaign.title}; {design.describe()}; {counted(total, 'run')}",
        flush=True,
    )
    metadata = {
        "simulated": "true", "benchtool": __version__, **campaign.metadata, **design.words(),
        "set": " ".join(words_of(study.settings, commas=False)),
    }  # fmt: skip
    began = time.monotonic()
    columns = (MofNCompleteColumn(), TimeRemainingColumn())
    with progress_bar(*columns, transient=False) as progress, _rows_stay(table):
        task = progress.add_task("runs", total=total)

        def written(done: int) -> None:
            progress.update(task, completed=done)

        count = run_campaign(campaign, inputs, design, table, metadata, written)
    took_s = max(time.monotonic() - began, 1e-9)
    print(f"{counted(count, 'run')} in {took_s:.1f} s, {count / took_s:.3g} runs/s")
    print(f"written: {table}", flush=True)
    cells = campaign_map(table, campaign, design, drawn)
    print(f"{campaign.measures[drawn].text}, mean of all:")
    for panel in cells.panels:
        mean = panel.total.sum() / max(panel.count.sum(), 1.0)
        print(f"  {', '.join(filter(None, (panel.column, panel.row)))}: {mean:.3g}")
    block = drawn_figures("flight.campaign", cells)["campaign"]
    for path in save_figure(block.figure, out / "campaign"):
        print(f"written: {path}")


@contextmanager
def _rows_stay(table: Path) -> Iterator[None]:
    """Say where the rows are when a campaign is ended."""
    try:
        yield
    except KeyboardInterrupt:
        rows = finished_runs(table)
        print(f"ended; finished runs are in {rows}; the same command resumes", file=sys.stderr)
        raise
