"""Static runs of the UIUC Propeller Database: RPM, CT, CP in files named by propeller."""

from __future__ import annotations

import re
from dataclasses import replace
from math import pi
from pathlib import Path

import numpy as np

from benchtool.core.air import STANDARD_DENSITY_KG_M3
from benchtool.core.channel import Channel
from benchtool.core.errors import FileFormatError
from benchtool.core.units import from_si
from benchtool.data.csv_text import TextTable
from benchtool.data.propeller_file import load_propeller
from benchtool.data.repairs.column_mapping import map_header, read_columns
from benchtool.data.repairs.import_result import Finding, ImportOptions, ImportResult

_SIZE = re.compile(r"_(?P<size>\d+(?:\.\d+)?x\d+(?:\.\d+)?)")


def is_uiuc(head: bytes) -> bool:
    """Return whether a file begins like a static run of the database."""
    return head.split(maxsplit=3)[:3] == [b"RPM", b"CT", b"CP"]


def read_uiuc(table: TextTable, options: ImportOptions) -> ImportResult:
    """Return a static run: T = CT rho n^2 D^4, Q = CP rho n^2 D^5 / (2 pi), n in turns a second.

    The file's name contains the diameter in inches. Coefficients as in Brandt and Selig,
    AIAA 2011-1255.
    """
    size = _SIZE.search(Path(table.where).name)
    if size is None and options.propeller is None:
        raise FileFormatError(
            table.where,
            "the file name contains no diameter (as in apcsf_10x7_static_...); rename the file or "
            "use --propeller 10x7",
        )
    propeller = options.propeller or load_propeller(size["size"] if size else "")
    diameter_m = propeller.diameter_m
    columns, others = map_header(table, {"RPM": "rpm1", "CT": "ct", "CP": "cp"}.get)
    density = STANDARD_DENSITY_KG_M3  # the database has no air data; assumed
    if options.air_density_kg_m3 is not None:
        density = options.air_density_kg_m3
    findings = [
        Finding("lacks", "time", "a table of steady speeds: rows are ordered but have no time"),
        Finding(
            "read as", "diameter",
            f"{from_si(diameter_m, 'in'):.4g} in, "
            f"{'by --propeller' if options.propeller else 'from the name of the file'}",
        ),
    ]  # fmt: skip
    if options.air_density_kg_m3 is None:
        text = f"none in the file; thrust and torque for {density:g} kg/m3 (--air-density)"
        findings.append(Finding("doubt", "air density", text, "thrust_N"))
    result = read_columns(table, columns, {}, [*findings, *others])
    recording = result.recording
    for need in ("rpm1", "ct"):
        if need not in recording:
            raise FileFormatError(table.where, f"column {need} is missing; correct the table")
    turns_per_s = recording.column("rpm1") / 60.0
    thrust = recording.column("ct") * density * turns_per_s**2 * diameter_m**4
    recording = recording.with_column(Channel("thrust_N", "N"), thrust)
    if "cp" in recording:
        torque = recording.column("cp") * density * turns_per_s**2 * diameter_m**5 / (2.0 * pi)
        recording = recording.with_column(Channel("torque_Nm", "N m"), np.asarray(torque))
    facts = {**recording.provenance, "diameter_m": f"{diameter_m:.6g}", "air_kg_m3": f"{density:g}"}
    formulas = {"thrust_N": "CT rho n^2 D^4", "torque_Nm": "CP rho n^2 D^5 / (2 pi)"}
    sources, recording = {**result.sources, **formulas}, replace(recording, provenance=facts)
    return replace(result, recording=recording, sources=sources, propeller=propeller)
