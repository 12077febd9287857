"""Command `benchtool import`: recordings from flight logs and files of other test stands."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from annotated_types import Ge, Gt, Le

from benchtool.commands.input_commands import command_from_inputs
from benchtool.core.errors import InputError, WouldOverwrite
from benchtool.core.inputs import Input, Inputs, to_arguments, with_changes
from benchtool.core.user_file import open_file

if TYPE_CHECKING:
    from benchtool.data.repairs.import_result import ImportOptions, ImportResult


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportInputs(Inputs):
    """Options of `benchtool import`."""

    files: Annotated[tuple[Path, ...], Input("Files to import.", argument="FILE")]
    columns: Annotated[Path | None, Input("Column map (TOML) of a CSV, with units.")] = None
    over: Annotated[
        tuple[str, ...], Input("START:END:ROTOR in s: rotor (or all) is over a surface.")
    ] = ()
    near_m: Annotated[
        Annotated[float, Ge(0.0), Le(1e5)] | None,
        Input("Distance sensor reading below which a surface is near.", "m"),
    ] = None
    flip: Annotated[
        tuple[str, ...], Input("Channel to invert the sign of, e.g. thrust_N.", group="Repairs")
    ] = ()
    tare: Annotated[tuple[str, ...], Input("Channel to tare with its reading at rest.")] = ()
    scale: Annotated[tuple[str, ...], Input("CHANNEL=FACTOR, e.g. rpm1=1/6 for a pole count.")] = ()
    air_density: Annotated[
        Annotated[float, Gt(0.0), Le(100.0)] | None,
        Input("Air density for coefficient files.", "kg/m3", group="Bench"),
    ] = None
    propeller: Annotated[
        str, Input("Propeller: name (benchtool library propellers), file, or inches: 10x4.5.")
    ] = ""
    hover: Annotated[
        Annotated[float, Gt(0.0), Le(1000.0)] | None,
        Input("Vehicle mass; extracts points from steady hover.", "kg"),
    ] = None
    out: Annotated[
        Path | None, Input("Folder, or a .csv or .parquet file for one import.", group="Results")
    ] = None
    parquet: Annotated[bool, Input("Write Parquet instead of CSV.")] = False
    overwrite: Annotated[bool, Input("Replace existing recordings.")] = False
    dry_run: Annotated[bool, Input("Print the findings only.")] = False

    def options(self) -> ImportOptions:
        """Return the options of the importer, with windows and propeller parsed."""
        from benchtool.data.propeller_file import load_propeller
        from benchtool.data.repairs.flight_windows import parse_window
        from benchtool.data.repairs.import_result import ImportOptions

        return ImportOptions(
            columns=self.columns,
            flip=self.flip,
            tare=self.tare,
            scale=self.scale,
            air_density_kg_m3=self.air_density,
            propeller=load_propeller(self.propeller) if self.propeller else None,
            hover_kg=self.hover,
            over=tuple(parse_window(text) for text in self.over),
            near_m=self.near_m,
        )


@command_from_inputs(ImportInputs)
def import_(inputs: ImportInputs) -> None:
    """Import flight logs and files of other test stands."""
    for file in inputs.files:
        if not file.exists():
            open_file(file)  # raises the error
    from benchtool.data.formats.formats import import_files
    from benchtool.data.repairs.import_result import import_metadata
    from benchtool.data.run.recording_file import metadata_path, write_recording

    options = inputs.options()
    files = inputs.files
    targets = _targets(files, inputs.out, inputs.parquet)
    if not inputs.overwrite and not inputs.dry_run:
        # Checked before a long import.
        for target in targets:
            for path in (target, metadata_path(target)):
                if path.exists():
                    raise WouldOverwrite(str(path), "--overwrite")
    for file, result, target in zip(files, import_files(files, options), targets, strict=True):
        if not inputs.dry_run:
            write_recording(
                target,
                result.recording,
                import_metadata(result, options),
                overwrite=inputs.overwrite,
            )
        _print_import(result, None if inputs.dry_run else target)
        _print_next(inputs, file, result, target)


def _print_next(inputs: ImportInputs, file: Path, result: ImportResult, target: Path) -> None:
    """Print the command that applies the options of the doubts, and the motor test of a log."""
    doubts = [finding.words for finding in result.findings if finding.kind == "doubt"]
    options = re.findall(r"--(flip|tare|scale) ([\w=./]+)", " ".join(doubts))
    if options:
        values = with_changes(replace(inputs, overwrite=True, dry_run=False, files=(file,)))
        for option, value in dict.fromkeys(options):
            values[option] = (*values.get(option, ()), value)
        command = ["benchtool", "import", *to_arguments(ImportInputs, values)]
        print(f"if the doubts are right: {shlex.join(command)}")
    names = result.recording.names
    is_usable = not inputs.dry_run and ("flip", "thrust_N") not in options and "rpm2" not in names
    if is_usable and {"pwm1_us", "thrust_N"} <= set(names):
        size = " --propeller SIZE" if result.propeller is None else ""
        print(f"next: {shlex.join(['benchtool', 'motor', str(target)])}{size}")


def _targets(files: tuple[Path, ...], out: Path | None, parquet: bool) -> list[Path]:
    if out is not None and out.suffix.lower() in (".csv", ".parquet"):
        if len(files) > 1:
            raise InputError(f"--out {out} is one file for {len(files)} imports; use a folder")
        return [out]
    folder = Path("imported") if out is None else out
    ending = ".parquet" if parquet else ".csv"
    targets = [folder / f"{path.stem}{ending}" for path in files]
    for target in targets:
        if targets.count(target) > 1:
            raise InputError(f"two files have the same target {target}; import them one at a time")
    return targets


def _print_import(result: ImportResult, target: Path | None) -> None:
    """Print summary and findings of one import."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table
    from rich.text import Text

    from benchtool.commands.terminal.tables import Output

    console = Output()
    tally = result.tally
    parts = [f"{tally.kept:,} of {tally.total:,} {tally.unit}s kept"]
    if tally.not_needed:
        parts.append(f"{tally.not_needed:,} of other kinds")
    parts.append(f"{tally.refused:,} rejected")
    source = result.recording.provenance.get("file", "")
    console.print_lines(f"{source}: {result.format}; {', '.join(parts)}")
    console.print_lines(f"channels: {', '.join(result.recording.names)}")
    for window in result.windows:
        rotor = f"rotor {window.rotor}" if window.rotor else "all rotors"
        console.print_lines(
            f"over a surface: {rotor}, {window.start_s:.6g} s to {window.end_s:.6g} s "
            f"(source: {window.source})"
        )
    if result.findings:
        table = Table(box=SIMPLE_HEAD)
        table.add_column("kind", no_wrap=True)
        table.add_column("finding", overflow="fold", max_width=18)
        table.add_column("channel", overflow="fold", max_width=16)
        table.add_column("details", overflow="fold")
        for finding in sorted(result.findings, key=lambda finding: finding.kind != "doubt"):
            lines = finding.lines if len(finding.lines) <= 40 else f"{finding.lines[:36]} ..."
            details = f"{finding.words} (line {lines})" if finding.lines else finding.words
            table.add_row(*map(Text, (finding.kind, finding.what, finding.channel, details)))
        console.print(table)
    if target is not None:
        console.print_lines(f"written: {target} and {target.name}.json")
