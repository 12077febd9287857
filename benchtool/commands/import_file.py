"""`benchtool import`: flight logs and other makers' files into recordings, repairs told."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from benchtool.data.repairs.imported import Imported, Options


def command(
    files: Annotated[list[Path], typer.Argument(help="Files to import; each becomes one.")],
    columns: Annotated[
        Path | None, typer.Option(help="Column map (TOML) of any CSV, with units.")
    ] = None,
    over: Annotated[
        list[str] | None,
        typer.Option(help="START:END:ROTOR, s: that rotor is over a surface; 'all' for each."),
    ] = None,
    near_m: Annotated[
        float | None,
        typer.Option("--near-m", help="A distance sensor below it says: over a surface.", min=0.0),
    ] = None,
    flip: Annotated[
        list[str] | None, typer.Option(help="Channel whose sign is turned (thrust_N).")
    ] = None,
    tare: Annotated[
        list[str] | None, typer.Option(help="Channel whose reading at rest is taken off.")
    ] = None,
    scale: Annotated[
        list[str] | None, typer.Option(help="CHANNEL=FACTOR, as rpm1=1/6 for a pole count.")
    ] = None,
    air_density: Annotated[
        float | None, typer.Option("--air-density", help="kg/m3, for files of coefficients.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder; or for one file, its name in .csv or .parquet.")
    ] = None,
    parquet: Annotated[bool, typer.Option("--parquet", help="Write Parquet, not CSV.")] = False,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace recordings of the same name.")
    ] = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Show findings, write nothing.")] = (
        False
    ),
) -> None:
    """Import flight logs and other makers' files, every repair told"""
    from benchtool.commands.terminal.show_import import print_import
    from benchtool.core.errors import WouldOverwrite
    from benchtool.data.formats.formats import import_files
    from benchtool.data.formats.over_surface import window_told
    from benchtool.data.repairs.imported import Options
    from benchtool.data.run.recording_file import beside

    options = Options(
        columns=columns,
        flip=tuple(flip or ()),
        tare=tuple(tare or ()),
        scale=tuple(scale or ()),
        air_density_kg_m3=air_density,
        over=tuple(window_told(text) for text in over or ()),
        near_m=near_m,
    )
    targets = _targets(files, out, parquet)
    if not overwrite and not dry_run:
        # Before the work, so that a long import does not end in a refusal.
        for target in targets:
            for path in (target, beside(target)):
                if path.exists():
                    raise WouldOverwrite(str(path), "--overwrite")
    for read, target in zip(import_files(files, options), targets, strict=True):
        if not dry_run:
            _write(read, target, options, overwrite)
        print_import(read, None if dry_run else target)


def _targets(files: list[Path], out: Path | None, parquet: bool) -> list[Path]:
    """Return where each file's recording is written."""
    from benchtool.core.errors import InputError

    if out is not None and out.suffix.lower() in (".csv", ".parquet"):
        if len(files) > 1:
            raise InputError(
                f"--out {out} names one file for {len(files)} imports; name a folder instead"
            )
        return [out]
    folder = Path("imported") if out is None else out
    ending = ".parquet" if parquet else ".csv"
    targets = [folder / f"{path.stem}{ending}" for path in files]
    for target in targets:
        if targets.count(target) > 1:
            raise InputError(f"two files would both become {target}; import them one at a time")
    return targets


def _write(read: Imported, target: Path, options: Options, overwrite: bool) -> None:
    from dataclasses import asdict

    from benchtool import __version__
    from benchtool.data.run.recording_file import write_recording

    facts = {
        "imported_as": read.format,
        "tally": asdict(read.tally),
        "sources": dict(read.sources),
        "findings": [asdict(item) for item in read.findings],
        "windows": [asdict(item) for item in read.windows],
        "options": {
            key: str(value) for key, value in asdict(options).items() if value not in (None, ())
        },
        "versions": {"benchtool": __version__},
    }
    write_recording(target, read.recording, facts, overwrite=overwrite)
