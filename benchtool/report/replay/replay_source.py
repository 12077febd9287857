"""Recording with its metadata files, and its page: ranges, stand figures, provenance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from benchtool import __version__
from benchtool.core.errors import FileFormatError
from benchtool.core.recording import Recording
from benchtool.core.text import pluralize
from benchtool.core.units import from_si
from benchtool.data.atomic import data_hash, file_hash
from benchtool.data.derived import add_quantities, build_recording_context, derive_quantities
from benchtool.data.formats.formats import import_file
from benchtool.data.repairs.import_result import ImportOptions, import_metadata
from benchtool.data.run.read import read_pitch
from benchtool.data.run.recording_file import metadata_path, read_recording, read_recording_facts
from benchtool.data.run.run import Run
from benchtool.explain.pitch.replay import read_provenance
from benchtool.report.figure import figure
from benchtool.report.numbers import display_unit, format_number
from benchtool.report.page import Block, Listing, Page, Section, Table
from benchtool.report.palette import BLACK
from benchtool.report.panels import origins_table
from benchtool.report.run_facts import (
    MISSING_VALUE,
    bench_facts,
    condition_facts,
    data_facts,
    version_facts,
)
from benchtool.report.sweep.samples import draw_samples, samples_height

if TYPE_CHECKING:
    from matplotlib.figure import Figure


PLAN = "Plan of the experiment (plan.toml)."
MODELLED = ("model", "controller", "gains", "schedule", "seed", "truth", "rig", "device")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ReplaySource:
    """Recording with its metadata."""

    path: Path
    recording: Recording
    facts: Mapping[str, Any]  # metadata of a run, or of the JSON file of a recording
    provenance: Mapping[str, str]  # controller, gains and so on
    sha256: str

    def __repr__(self) -> str:
        return f"ReplaySource {self.path}: {len(self.recording)} rows"

    @property
    def name(self) -> str:
        return self.path.resolve().name

    @property
    def simulated(self) -> bool:
        return self.recording.simulated

    def with_quantities(self) -> Recording:
        """Return the recording, with derived quantities unless it is a pitch run."""
        if self.is_run:
            return self.recording
        return add_quantities(self.recording, build_recording_context(self.facts, str(self.path)))

    @property
    def is_run(self) -> bool:
        return self.path.is_dir()


def read_recorded(path: Path) -> ReplaySource:
    """Read a pitch run, a recording file with its metadata, or a log of another program."""
    if path.is_dir():
        facts, recording = Run.open(path).metadata, read_pitch(path)
    elif not path.exists():
        raise FileFormatError(str(path), "file or run folder not found; check the path")
    elif path.suffix.lower() == ".mcap":  # contains its metadata
        facts, recording = {}, read_recording(path)
    elif metadata_path(path).exists():
        facts = read_recording_facts(path)
        recording = read_recording(path)
    else:
        imported = import_file(path)
        facts, recording = import_metadata(imported, ImportOptions()), imported.recording
    return ReplaySource(
        path=path,
        recording=recording,
        facts=facts,
        provenance=read_provenance(facts) if path.is_dir() else recording.provenance,
        sha256=data_hash(path) if path.is_dir() else file_hash(path),
    )


def sections_behind(recorded: ReplaySource) -> list[Section]:
    """Return the provenance sections of a recording: rig, air, repairs, hashes."""
    facts, recording = recorded.facts, recorded.recording
    if recorded.is_run:
        samples_hash = {"samples.csv": file_hash(recorded.path / "samples.csv")}
        return [
            Section("Rig and device", [bench_facts(facts)]),
            Section("Conditions and calibration", [condition_facts(facts)]),
            Section("Experiment", [Listing(PLAN, Run.open(recorded.path).plan_text)]),
            Section("Software and data", [data_facts(facts, recorded.sha256, samples_hash)]),
        ]
    provenance = {key: value for key, value in recording.provenance.items() if value}
    if "file" in provenance:
        provenance["file"] = Path(provenance["file"]).name
    listed = {key: provenance[key] for key in MODELLED if key in provenance} | provenance
    listed |= {
        "read as": str(facts.get("imported_as", "a recording of benchtool")),
        "rows": str(len(recording)),
        "channels": ", ".join(f"{item.name} [{item.unit}]" for item in recording.channels),
    }
    (versions,) = version_facts(facts).values()
    if versions == MISSING_VALUE:
        versions = str(facts.get("software", MISSING_VALUE))
    software = {"simulated with" if recorded.simulated else "written with": versions}
    if "imported_as" in facts:
        device = provenance.get("device", MISSING_VALUE)
        software = {"recorded with": device, "imported with": versions}
    software["reported with"] = f"benchtool {__version__}"
    software[f"sha256 of {recorded.name}"] = recorded.sha256
    if windows := [
        f"{item['start_s']:g} to {item['end_s']:g} s, "
        f"{'all rotors' if not item['rotor'] else 'rotor ' + str(item['rotor'])} ({item['source']})"
        for item in facts.get("windows") or []
    ]:
        listed["over a surface"] = "; ".join(windows)
    findings = [Section("Repairs and doubts", _findings(facts))] if facts.get("findings") else []
    return [
        *findings,
        Section("Where it comes from", [listed]),
        Section("Software and data", [software]),
    ]


def _findings(facts: Mapping[str, Any]) -> list[Block]:
    blocks: list[Block] = []
    if tally := facts.get("tally"):
        blocks.append(
            f"{tally['total']} {tally['unit']}s in the file: {tally['kept']} used, "
            f"{tally['refused']} rejected, {tally['not_needed']} of types without use in a "
            f"recording."
        )
    rows = [
        (item["kind"], item["what"], item.get("channel") or "–", item["words"])
        for item in facts["findings"]
    ]
    caption = "Findings of the import: repairs, doubts, rejected and missing data."
    heads = ("kind", "finding", "channel", "text")
    return [*blocks, Table(caption, heads, rows, text_columns=4)]


def _has_samples(recorded: ReplaySource) -> bool:
    return "time_s" in recorded.recording and "thrust_N" in recorded.recording


@figure(
    page="replay.stand",
    title="Samples: {0.name}",
    caption="Samples of the recording after import.",
    when=_has_samples,
    height_in=lambda recorded: samples_height(recorded.recording),
)
def samples(figure: Figure, recorded: ReplaySource) -> None:
    """Draw the signals of a recording as stacked panels."""
    draw_samples(figure, recorded.recording)


def _has_thrust_and_speed(recorded: ReplaySource) -> NDArray[np.bool_]:
    recording = recorded.recording
    if "thrust_N" not in recording or "rpm1" not in recording:
        return np.zeros(len(recording), bool)
    return np.isfinite(recording.to_si("rpm1")) & np.isfinite(recording.to_si("thrust_N"))


@figure(
    page="replay.stand",
    title="Thrust against speed of rotor 1: {0.name}",
    caption="Thrust against rotor speed per sample; the file contains no plate distance.",
    when=lambda recorded: bool(_has_thrust_and_speed(recorded).any()),
    height_in=4.4,
)
def thrust(figure: Figure, recorded: ReplaySource) -> None:
    """Draw thrust against rotor speed."""
    axes, rows = figure.subplots(), _has_thrust_and_speed(recorded)
    rpm = from_si(recorded.recording.to_si("rpm1")[rows], "rpm")
    thrust_N = recorded.recording.to_si("thrust_N")[rows]
    axes.plot(rpm, thrust_N, "s", ms=4.2, color=BLACK, label="samples of the recording")
    axes.set(xlabel="rotor speed [rpm]", ylabel="thrust [N]")
    axes.legend(loc="upper left")


def _quantities(recorded: ReplaySource) -> Block | None:
    if recorded.is_run:
        return None
    quantities = derive_quantities(
        recorded.recording, build_recording_context(recorded.facts, str(recorded.path))
    )
    return origins_table(quantities) if quantities else None


def _nothing_drawn(recorded: ReplaySource) -> Block | None:
    if _has_samples(recorded) or _has_thrust_and_speed(recorded).any():
        return None
    return "The recording contains neither thrust nor attitude; see the channels below."


def _ranges(recorded: ReplaySource) -> Block:
    rows = []
    for channel in recorded.recording.channels:
        values = recorded.recording.column(channel.name)
        finite = values[np.isfinite(values)]
        numbers = ["–"] * 3
        if finite.size:
            numbers = [
                format_number(statistic(finite), ".5g") for statistic in (np.min, np.median, np.max)
            ]
        unit = "µs" if channel.unit == "pwm_us" else display_unit(channel.unit)
        rows.append((channel.name, unit, str(finite.size), *numbers))
    heads = ("channel", "unit", "values", "minimum", "median", "maximum")
    return Table("Range of each channel.", heads, rows, text_columns=2)


def stand_summary(recorded: ReplaySource) -> str:
    """Return a summary of a recording without attitude."""
    recording = recorded.recording
    duration = ""
    if "time_s" in recording and np.isfinite(time_s := recording.to_si("time_s")).any():
        duration = f" over {np.nanmax(time_s):.4g} s"
    rows, channels = pluralize(len(recording), "row"), pluralize(len(recording.names), "channel")
    summary = f"{recorded.name}: {rows} of {channels}{duration}."
    if "thrust_N" in recording and np.isfinite(thrust := recording.to_si("thrust_N")).any():
        minimum, maximum = (
            format_number(statistic(thrust), ".4g") for statistic in (np.nanmin, np.nanmax)
        )
        summary += f" Thrust from {minimum} to {maximum} N."
    return summary


STAND = Page(
    "replay.stand",
    [
        ("What was recorded", ["samples", "thrust", _nothing_drawn, _ranges, _quantities]),
        sections_behind,
    ],
    title="Recording: {0.name}",
    summary=stand_summary,
)
