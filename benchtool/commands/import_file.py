"""`benchtool import`: flight logs and other makers' files into recordings, repairs listed."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from annotated_types import Ge, Gt, Le

from benchtool.commands.input_commands import command_from_inputs
from benchtool.core.errors import InputError, WouldOverwrite
from benchtool.core.inputs import Input, Inputs

if TYPE_CHECKING:
    from benchtool.data.repairs.import_result import ImportOptions


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportInputs(Inputs):
    """What `benchtool import` takes."""

    files: Annotated[tuple[Path, ...], Input("Files to import; each becomes one.", argument="FILE")]
    columns: Annotated[Path | None, Input("Column map (TOML) of any CSV, with units.")] = None
    over: Annotated[
        tuple[str, ...], Input("START:END:ROTOR, s: that rotor is over a surface; 'all' for each.")
    ] = ()
    near_m: Annotated[
        Annotated[float, Ge(0.0), Le(1e5)] | None,
        Input("A distance sensor below it says: over a surface.", "m"),
    ] = None
    flip: Annotated[
        tuple[str, ...], Input("Channel whose sign is inverted (thrust_N).", group="Repairs")
    ] = ()
    tare: Annotated[tuple[str, ...], Input("Channel whose reading at rest is taken off.")] = ()
    scale: Annotated[tuple[str, ...], Input("CHANNEL=FACTOR, as rpm1=1/6 for a pole count.")] = ()
    air_density: Annotated[
        Annotated[float, Gt(0.0), Le(100.0)] | None,
        Input("Air density, for files of coefficients.", "kg/m3", group="Bench"),
    ] = None
    propeller: Annotated[
        str,
        Input("Propeller: name (benchtool library propellers), file, or size in inches: 10x4.5."),
    ] = ""
    hover: Annotated[
        Annotated[float, Gt(0.0), Le(1000.0)] | None,
        Input("Mass: makes points of a hover flight's steady stays.", "kg"),
    ] = None
    out: Annotated[
        Path | None,
        Input("Folder; or for one file, its name in .csv or .parquet.", group="Results"),
    ] = None
    parquet: Annotated[bool, Input("Write Parquet, not CSV.")] = False
    overwrite: Annotated[bool, Input("Replace recordings of the same name.")] = False
    dry_run: Annotated[bool, Input("Show findings, write nothing.")] = False

    def options(self) -> ImportOptions:
        """Return what the importer takes of these.

        Raises:
            InputError: a window or a propeller that cannot be read.
        """
        from benchtool.data.formats.surface_windows import parse_window
        from benchtool.data.propeller_file import load_propeller
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
    from benchtool.commands.terminal.show_import import print_import
    from benchtool.data.formats.formats import import_files
    from benchtool.data.repairs.import_result import import_metadata
    from benchtool.data.run.recording_file import metadata_path, write_recording

    options = inputs.options()
    files = inputs.files
    targets = _targets(files, inputs.out, inputs.parquet)
    if not inputs.overwrite and not inputs.dry_run:
        # Before the work, so that a long import does not end in a refusal.
        for target in targets:
            for path in (target, metadata_path(target)):
                if path.exists():
                    raise WouldOverwrite(str(path), "--overwrite")
    for read, target in zip(import_files(files, options), targets, strict=True):
        if not inputs.dry_run:
            write_recording(
                target, read.recording, import_metadata(read, options), overwrite=inputs.overwrite
            )
        print_import(read, None if inputs.dry_run else target)


def _targets(files: tuple[Path, ...], out: Path | None, parquet: bool) -> list[Path]:
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
