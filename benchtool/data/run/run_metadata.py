"""Schemas of a run's metadata.json and of a recording's JSON file, checked on reading.

Keys are optional and unknown keys are allowed. Values of a wrong type or out of range raise an
error with their key.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field, make_dataclass
from pathlib import Path
from types import GenericAlias
from typing import Annotated, Any

from annotated_types import Ge, Le, Len

from benchtool.core.errors import FileFormatError
from benchtool.core.rig import Body, PlateDrive, Propulsion, RotorPosition, Sensor
from benchtool.core.toml_text import build_dataclass
from benchtool.data.atomic import read_json
from benchtool.data.calibration import CalibrationComponent
from benchtool.data.repairs.import_result import Count, Finding, ImportCount, Window

NonNegative = Annotated[float, Ge(0.0), Le(1e9)]
Row = Annotated[tuple[float, float], Len(2)]
Texts = Mapping[str, str]


def _table(title: str, /, **keys: Any) -> Any:
    """Return a dataclass with these keys and types; a key that ends in _ is required."""
    config: dict[str, Any] = {"allow_inf_nan": False}
    fields: list[Any] = [
        (key[:-1], kind) if key.endswith("_") else (key, kind, field(default=None))
        for key, kind in keys.items()
    ]
    return make_dataclass(title, fields, kw_only=True, namespace={"__pydantic_config__": config})


def _list(title: str, /, **keys: Any) -> Any:
    """Return the type of a list of tables."""
    return GenericAlias(tuple, (_table(title, **keys), ...))


_DEVICE = _table(
    "Device", firmware=str, protocol=str, rate_Hz=NonNegative, watchdog_s=NonNegative | None,
    limits=Mapping[str, float] | None, channels=Texts | None, facts=Texts | None,
)  # fmt: skip
_AIR = _table(
    "Air", temperature_degC_=float, pressure_Pa_=float, humidity_=float, density_kg_m3_=float,
    measured=bool, formula=str,
)  # fmt: skip
_CALIBRATION = _table(
    "Calibration", id_=str, date_=str, device_id_=str, slope_N_per_count_=float,
    covariance_=tuple[Row, Row], relative_sd_=float, straightness_=float,
    masses_kg_=Annotated[tuple[float, ...], Len(1)], gravity_m_s2_=float, hysteresis=float | None,
    components=tuple[CalibrationComponent, ...], calibrated_by=str, certificate=str,
)  # fmt: skip
_RIG = _table(
    "Rig", name=str, title=str, rotors=tuple[RotorPosition, ...], propulsion=Propulsion | None,
    body=Body | None, plate=PlateDrive | None, sensors=Mapping[str, Sensor] | None,
    limits=Mapping[str, float] | None, sources=Texts | None, assumed=tuple[str, ...],
)  # fmt: skip
_LINK = _table("Link", samples=Count, lost=Count, corrupt=Count, repeated=Count)
_HASHES = _table("Hashes", parquet_sha256=str, csv_sha256=str)
_RUN = _table(
    "Run", format=str, state=str, reason=str | None, simulated=bool, started=str, operator=str,
    seed=int, address=str, device_id=str, device=_DEVICE | None, rig=_RIG | None,
    calibration=_CALIBRATION | None, air=_AIR | None, versions=Texts | None, link=_LINK | None,
    samples=_HASHES | None, points=_HASHES | None, plate=_table("Plate", stage=str | None) | None,
    visits=Count | None, experiment=str,
    merged_from=_list("Merged", run_=str, sha256=str),
)  # fmt: skip
RECORDING_SCHEMA = _table(
    "Recording", format_=str, sha256_=str, rows_=Count, simulated_=bool,
    channels_=_list("Channel", name_=str, unit_=str), provenance_=Texts,
    imported_as=str, software=str, versions=Texts | None, findings=tuple[Finding, ...] | None,
    windows=tuple[Window, ...] | None, tally=ImportCount | None,
)  # fmt: skip


def read_metadata(folder: Path) -> dict[str, Any]:
    """Return the contents of a run folder's metadata.json; symbolic links are not followed."""
    path = folder / "metadata.json"
    facts = read_json(path, follow=False)
    build_dataclass(_RUN, facts, str(path))
    return facts


def check_format(facts: Mapping[str, Any], expected: str, where: str) -> None:
    """Raise FileFormatError for a JSON file of another format."""
    if facts.get("format") != expected:
        raise FileFormatError(
            where, f"format {facts.get('format')!r} is not supported; allowed: {expected!r}"
        )
