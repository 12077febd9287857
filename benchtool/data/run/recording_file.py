"""Recording files, CSV or Parquet, each with a JSON file of its provenance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchtool.core.channel import Channel
from benchtool.core.errors import BenchtoolError, FileFormatError, WouldOverwrite
from benchtool.core.recording import Recording
from benchtool.data.atomic import atomic_writer, file_hash, make_folder, replace_json
from benchtool.data.mcap_file import read_mcap
from benchtool.data.parquet import read_parquet, read_stream, write_parquet
from benchtool.data.run.run_metadata import read_recording_facts
from benchtool.data.table import read_own_table

FORMAT = "benchtool-recording-1"


def metadata_path(path: Path) -> Path:
    """Return the path of the JSON file of a recording."""
    return path.with_name(f"{path.name}.json")


def write_recording(
    path: Path, recording: Recording, facts: Mapping[str, Any], *, overwrite: bool = False
) -> None:
    """Write a recording, then its JSON file with the table's hash, each atomically.

    Args:
        path: ends in .csv or .parquet.
        facts: extra keys of the JSON file.
    """
    suffix = path.suffix.lower()
    if suffix not in (".csv", ".parquet"):
        raise FileFormatError(
            str(path), f"suffix {suffix!r} is not supported; allowed: .csv, .parquet"
        )
    if not overwrite:
        for target in (path, metadata_path(path)):
            if target.exists():
                raise WouldOverwrite(str(target))
    make_folder(path.parent)
    if suffix == ".csv":
        _write_csv(path, recording)
    else:
        write_parquet(path, recording)
    channels = [{"name": item.name, "unit": item.unit} for item in recording.channels]
    replace_json(
        metadata_path(path),
        {
            "format": FORMAT,
            "sha256": file_hash(path),
            "rows": len(recording),
            "simulated": recording.simulated,
            "channels": channels,
            "provenance": dict(recording.provenance),
            **facts,
        },
    )


def read_recording(path: str | Path) -> Recording:
    """Return a recording of `write_recording` with its provenance, or that of an MCAP file."""
    path = Path(path)
    if not path.is_file():
        raise FileFormatError(str(path), "there is no such recording; check the path")
    if path.suffix.lower() == ".mcap":
        return read_mcap(path)
    facts = read_recording_facts(metadata_path(path), FORMAT)
    if facts.get("sha256") != file_hash(path):
        raise FileFormatError(
            str(path), "it has changed since it was written; import it again or restore a backup"
        )
    if path.suffix.lower() == ".csv":
        try:
            recording, _ = read_stream(path, None)
        except BenchtoolError:  # fallback for text or another format; errors name the line
            recording, _ = read_own_table(path)
    else:
        recording = read_parquet(path)
    units = {str(item["name"]): str(item["unit"]) for item in facts["channels"]}
    return replace(
        recording,
        channels=tuple(Channel(name, units.get(name, "")) for name in recording.names),
        provenance={str(key): str(value) for key, value in facts["provenance"].items()},
        simulated=bool(facts["simulated"]),
    )


def _write_csv(path: Path, recording: Recording) -> None:
    """Write with pyarrow without loss of precision; nan is an empty cell."""
    import pyarrow as pa
    from pyarrow import csv

    is_nan = np.isnan(recording.values)
    masks = [is_nan[:, index].copy() for index in range(len(recording.channels))]
    # Readers skip a line of empty cells only, so its first cell is the text nan.
    masks[0] &= ~is_nan.all(axis=1)
    columns = [
        pa.array(np.ascontiguousarray(recording.values[:, index]), mask=mask)
        for index, mask in enumerate(masks)
    ]
    table = pa.table(columns, names=list(recording.names))
    with atomic_writer(path, path.with_name(f".{path.name}.new")) as file:
        file.write(f"{','.join(recording.names)}\n".encode())
        csv.write_csv(table, file, csv.WriteOptions(include_header=False, quoting_style="none"))
