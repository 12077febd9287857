"""A campaign on the terminal: progress, how fast it went, and the files."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from benchtool.errors import InputError
from benchtool.report.files import refuse_existing, save_figure
from benchtool.studies.campaign import Vary, design, design_size, run_campaign, write_campaign
from benchtool.studies.campaign_map import campaign_map
from benchtool.studies.pitch_setup import PitchSetup


def run_with_progress(
    setup: PitchSetup,
    vary: Sequence[str],
    seeds: int,
    samples: int,
    seed: int,
    out: Path | None,
) -> None:
    """Run a campaign, show how far it is, write its table and its map."""
    varied = [Vary.read(text) for text in vary]
    if out is None:
        raise InputError("a campaign writes its results to disk; add --out FOLDER")
    table = out / "campaign.parquet"
    refuse_existing([table, out / "campaign.svg", out / "campaign.png"])
    total = design_size(varied, samples) * len(setup.controls) * seeds
    rows = run_campaign(setup, lambda: design(varied, samples, seed), seeds, seed)
    console = Console(stderr=True)
    began = time.monotonic()
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        console=console,
        disable=not sys.stderr.isatty(),
    ) as progress:
        task = progress.add_task("runs", total=total)
        metadata = {
            "simulated": "true",
            "model": setup.bench.model.name,
            "schedule": setup.schedule.name,
            "seed": str(seed),
        }
        count = write_campaign(
            rows, table, metadata, lambda done: progress.update(task, completed=done)
        )
    took_s = max(time.monotonic() - began, 1e-9)
    print(f"{count} runs in {took_s:.1f} s, {count / took_s:.0f} runs/s")
    print(f"written: {table}")
    for path in save_figure(campaign_map(table, varied), out / "campaign"):
        print(f"written: {path}")
