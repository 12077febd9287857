"""What metadata.json of a run and the JSON beside a recording must hold, checked when read.

Keys may be left out, and others than these may stand beside them; a value of another type or out
of its range is refused with its key, so that no reader of the facts meets one.
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


def _table(called: str, /, **keys: Any) -> Any:
    """Return a dataclass with those keys and types; one whose name ends in _ must be there."""
    config: dict[str, Any] = {"allow_inf_nan": False}
    fields: list[Any] = [
        (key[:-1], kind) if key.endswith("_") else (key, kind, field(default=None))
        for key, kind in keys.items()
    ]
    return make_dataclass(called, fields, kw_only=True, namespace={"__pydantic_config__": config})


def _list(called: str, /, **keys: Any) -> Any:
    """Return the type of a list of such tables."""
    return GenericAlias(tuple, (_table(called, **keys), ...))


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
_RECORDING = _table(
    "Recording", format_=str, sha256_=str, rows_=Count, simulated_=bool,
    channels_=_list("Channel", name_=str, unit_=str), provenance_=Texts,
    imported_as=str, software=str, versions=Texts | None, findings=tuple[Finding, ...] | None,
    windows=tuple[Window, ...] | None, tally=ImportCount | None,
)  # fmt: skip


def read_metadata(folder: Path) -> dict[str, Any]:
    """Return the facts of a run folder's metadata.json; a link in its place is not followed.

    Raises:
        FileFormatError: it cannot be read, or holds a value that no run states.
    """
    path = folder / "metadata.json"
    facts = read_json(path, follow=False)
    build_dataclass(_RUN, facts, str(path))
    return facts


def read_recording_facts(path: Path, format_: str) -> dict[str, Any]:
    """Return the facts of the JSON beside a recording.

    Raises:
        FileFormatError: it cannot be read, or holds a value that no recording states.
    """
    facts = read_json(path)
    if facts.get("format") != format_:
        raise FileFormatError(str(path), f"this is not the JSON of a {format_}")
    build_dataclass(_RECORDING, facts, str(path))
    return facts
