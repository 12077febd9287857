"""What metadata.json of a run and the JSON beside a recording must hold, checked when read.

Keys may be left out, and others than these may stand beside them; a value of another type or out
of its range is refused with its key, so that no reader of the facts meets one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar

from annotated_types import Ge, Le, Len

from benchtool.core.errors import FileFormatError
from benchtool.core.rig import Body, PlateDrive, Propulsion, RotorPlace, Sensor
from benchtool.core.toml_text import build
from benchtool.data.atomic import read_json
from benchtool.data.calibration import CalibrationComponent
from benchtool.data.repairs.imported import Count, Finding, Tally, Window

Row = Annotated[tuple[float, float], Len(2)]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Facts:
    __pydantic_config__: ClassVar[dict[str, Any]] = {"allow_inf_nan": False}


@dataclass(frozen=True, slots=True, kw_only=True)
class _Device(_Facts):
    firmware: str = ""
    protocol: str = ""
    rate_Hz: Annotated[float, Ge(0.0), Le(1e9)] = 0.0
    watchdog_s: Annotated[float, Ge(0.0), Le(1e9)] | None = None
    limits: Mapping[str, float] | None = None
    channels: Mapping[str, str] | None = None
    facts: Mapping[str, str] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class _Link(_Facts):
    samples: Count = 0
    lost: Count = 0
    corrupt: Count = 0
    repeated: Count = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class _Air(_Facts):
    temperature_degC: float
    pressure_Pa: float
    humidity: float
    density_kg_m3: float
    measured: bool = False
    formula: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Calibration(_Facts):
    id: str
    date: str
    device_id: str
    slope_N_per_count: float
    covariance: tuple[Row, Row]
    relative_sd: float
    straightness: float
    masses_kg: Annotated[tuple[float, ...], Len(1)]
    gravity_m_s2: float
    hysteresis: float | None = None
    components: tuple[CalibrationComponent, ...] = ()
    calibrated_by: str = ""
    certificate: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Rig(_Facts):
    name: str = ""
    title: str = ""
    rotors: tuple[RotorPlace, ...] = ()
    propulsion: Propulsion | None = None
    body: Body | None = None
    plate: PlateDrive | None = None
    sensors: Mapping[str, Sensor] | None = None
    limits: Mapping[str, float] | None = None
    sources: Mapping[str, str] | None = None
    assumed: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class _Hashes(_Facts):
    parquet_sha256: str = ""
    csv_sha256: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Plate(_Facts):
    stage: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class _Merged(_Facts):
    run: str
    sha256: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Run(_Facts):
    format: str = ""
    state: str = ""
    reason: str | None = None
    simulated: bool = False
    started: str = ""
    operator: str = ""
    seed: int = 0
    address: str = ""
    device_id: str = ""
    device: _Device | None = None
    rig: _Rig | None = None
    calibration: _Calibration | None = None
    air: _Air | None = None
    versions: Mapping[str, str] | None = None
    link: _Link | None = None
    samples: _Hashes | None = None
    points: _Hashes | None = None
    plate: _Plate | None = None
    visits: Count | None = None
    experiment: str = ""
    merged_from: tuple[_Merged, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class _Channel(_Facts):
    name: str
    unit: str


@dataclass(frozen=True, slots=True, kw_only=True)
class _Recording(_Facts):
    format: str
    sha256: str
    rows: Count
    simulated: bool
    channels: tuple[_Channel, ...]
    provenance: Mapping[str, str]
    imported_as: str = ""
    software: str = ""
    versions: Mapping[str, str] | None = None
    findings: tuple[Finding, ...] | None = None
    windows: tuple[Window, ...] | None = None
    tally: Tally | None = None


def read_metadata(folder: Path) -> dict[str, Any]:
    """Return the facts of a run folder's metadata.json; a link in its place is not followed.

    Raises:
        FileFormatError: it cannot be read, or holds a value that no run states.
    """
    path = folder / "metadata.json"
    facts = read_json(path, follow=False)
    build(_Run, facts, str(path))
    return facts


def read_recording_facts(path: Path, format_: str) -> dict[str, Any]:
    """Return the facts of the JSON beside a recording.

    Raises:
        FileFormatError: it cannot be read, or holds a value that no recording states.
    """
    facts = read_json(path)
    if facts.get("format") != format_:
        raise FileFormatError(str(path), f"this is not the JSON of a {format_}")
    build(_Recording, facts, str(path))
    return facts
