"""Recording with its metadata files, and page sections on its provenance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchtool import __version__
from benchtool.core.errors import FileFormatError
from benchtool.core.recording import Recording
from benchtool.data.atomic import data_hash, file_hash
from benchtool.data.derived import add_quantities, build_recording_context
from benchtool.data.formats.formats import import_file
from benchtool.data.repairs.import_result import ImportOptions, import_metadata
from benchtool.data.run.read import read_pitch
from benchtool.data.run.recording_file import FORMAT, metadata_path, read_recording
from benchtool.data.run.run import Run
from benchtool.data.run.run_metadata import read_recording_facts
from benchtool.explain.pitch.replay import read_provenance
from benchtool.report.page import Block, FactTable, Listing, Paragraph, Section, Table
from benchtool.report.run_facts import (
    MISSING_VALUE,
    air_facts,
    calibration_facts,
    device_facts,
    rig_facts,
    run_state_table,
    version_facts,
)

PLAN = "Plan of the experiment (plan.toml)."
MODELLED = ("model", "controller", "gains", "schedule", "seed", "truth", "rig", "device")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ReplaySource:
    """Recording with its metadata."""

    path: Path
    recording: Recording
    facts: Mapping[str, Any]  # metadata of a run, or of the JSON file of a recording
    provenance: Mapping[str, str]  # controller, gains and so on
    plan_text: str  # "" for a file
    sha256: str

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
        run = Run.open(path)
        facts, recording, plan_text = run.metadata, read_pitch(path), run.plan_text
        provenance: Mapping[str, str] = read_provenance(facts)
        sha256 = data_hash(path)
    else:
        if not path.exists():
            raise FileFormatError(str(path), "file or run folder not found; check the path")
        is_mcap = path.suffix.lower() == ".mcap"  # contains its metadata
        if is_mcap or metadata_path(path).exists():
            facts = {} if is_mcap else read_recording_facts(metadata_path(path), FORMAT)
            recording = read_recording(path)
        else:
            imported = import_file(path)
            facts, recording = import_metadata(imported, ImportOptions()), imported.recording
        provenance, plan_text, sha256 = recording.provenance, "", file_hash(path)
    return ReplaySource(
        path=path,
        recording=recording,
        facts=facts,
        provenance=provenance,
        plan_text=plan_text,
        sha256=sha256,
    )


def sections_behind(recorded: ReplaySource) -> list[Section]:
    """Return the provenance sections of a recording: rig, air, repairs, hashes."""
    facts, recording = recorded.facts, recorded.recording
    if recorded.is_run:
        conditions = run_state_table(facts) | air_facts(facts) | calibration_facts(facts)
        hashes = version_facts(facts) | {
            "reported with": f"benchtool {__version__}",
            "sha256 of the run's data (points and samples)": recorded.sha256,
            "sha256 of samples.csv": file_hash(recorded.path / "samples.csv"),
        }
        return [
            Section("Rig and device", [FactTable(rig_facts(facts) | device_facts(facts))]),
            Section("Conditions and calibration", [FactTable(conditions)]),
            Section("Experiment", [Listing(PLAN, recorded.plan_text)]),
            Section("Software and data", [FactTable(hashes)]),
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
    software = _made_with(recorded) | {
        "reported with": f"benchtool {__version__}",
        f"sha256 of {recorded.name}": recorded.sha256,
    }
    findings = facts.get("findings")
    return [
        *([Section("Repairs and doubts", _findings(findings, facts))] if findings else []),
        Section("Where it comes from", [FactTable(listed | _windows(facts))]),
        Section("Software and data", [FactTable(software)]),
    ]


def _made_with(recorded: ReplaySource) -> dict[str, str]:
    """Return the software that recorded a file and that imported, simulated or wrote it."""
    facts = recorded.facts
    (listed,) = version_facts(facts).values()
    if listed == MISSING_VALUE and "software" in facts:
        listed = str(facts["software"])
    if "imported_as" in facts:
        device = recorded.recording.provenance.get("device") or MISSING_VALUE
        return {"recorded with": device, "imported with": listed}
    return {"simulated with" if recorded.simulated else "written with": listed}


def _windows(facts: Mapping[str, Any]) -> dict[str, str]:
    listed = [
        f"{item['start_s']:g} to {item['end_s']:g} s, "
        f"{'all rotors' if not item['rotor'] else 'rotor ' + str(item['rotor'])} ({item['source']})"
        for item in facts.get("windows") or []
    ]
    return {"over a surface": "; ".join(listed)} if listed else {}


def _findings(findings: Sequence[Mapping[str, Any]], facts: Mapping[str, Any]) -> list[Block]:
    blocks: list[Block] = []
    if tally := facts.get("tally"):
        blocks.append(
            Paragraph(
                f"{tally['total']} {tally['unit']}s in the file: {tally['kept']} used, "
                f"{tally['refused']} rejected, {tally['not_needed']} of types without use in a "
                f"recording."
            )
        )
    rows = [
        (item["kind"], item["what"], item.get("channel") or "–", item["words"]) for item in findings
    ]
    caption = "Findings of the import: repairs, doubts, rejected and missing data."
    heads = ("kind", "finding", "channel", "text")
    return [*blocks, Table(caption, heads, rows, text_columns=4)]
