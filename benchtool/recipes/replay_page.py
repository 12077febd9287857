"""The report page of a recording: what a log holds, and the simulated run beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchtool import __version__
from benchtool.core.recording import Recording
from benchtool.core.schedule import PARKED_M
from benchtool.recipes.pitch_track import PitchTrack, pitch_track
from benchtool.recipes.replayed import Beside, Replay, provenance_of_run, replayed
from benchtool.recipes.stand_page import stand_sections
from benchtool.report.page import (
    Block,
    Commands,
    Facts,
    FigureBlock,
    Listing,
    Paragraph,
    Report,
    Section,
    Table,
    Warnings,
)
from benchtool.report.replay import ReplayTrace, closer_figure, replay_figure
from benchtool.report.run_facts import (
    air_facts,
    calibration_facts,
    device_facts,
    rig_facts,
    state_facts,
    version_facts,
)
from benchtool.store import Run, data_hash, read_pitch, read_recording
from benchtool.store.atomic import read_json
from benchtool.store.digest import file_hash
from benchtool.store.recording_file import beside as facts_beside

Array = NDArray[np.float64]

MODELLED = ("model", "controller", "gains", "schedule", "seed", "truth", "rig", "device")
"""Facts of a recording that stand above others on its page."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Recorded:
    """Hold a recording with all that is written beside it.

    Attributes:
        path: run folder or file.
        recording: its values.
        facts: metadata of a run, or the JSON beside a file.
        provenance: controller, gains and so on, where anything tells them.
        plan_text: of a run; empty for a file.
        sha256: of the data.
    """

    path: Path
    recording: Recording
    facts: Mapping[str, Any]
    provenance: Mapping[str, str]
    plan_text: str
    sha256: str

    @property
    def name(self) -> str:
        """The folder's or file's own name."""
        return self.path.resolve().name

    @property
    def is_run(self) -> bool:
        """Whether it is a run folder."""
        return self.path.is_dir()


def read_recorded(path: Path) -> Recorded:
    """Return a pitch run or a recording file with what stands beside it."""
    if path.is_dir():
        run = Run.open(path)
        metadata = run.metadata
        return Recorded(
            path=path,
            recording=read_pitch(path),
            facts=metadata,
            provenance=provenance_of_run(metadata),
            plan_text=run.plan_text,
            sha256=data_hash(path),
        )
    recording = read_recording(path)
    return Recorded(
        path=path,
        recording=recording,
        facts=read_json(facts_beside(path)),
        provenance=recording.provenance,
        plan_text="",
        sha256=file_hash(path),
    )


def recording_page(path: Path, beside: Beside, commands: Sequence[str]) -> Report:
    """Return the report page of a recording; with a model, its simulated run beside it."""
    recorded = read_recorded(path)
    recording = recorded.recording
    if "theta_rad" in recording and "time_s" in recording:
        sections, summary, highlights = _pitch_sections(recorded, beside)
        title = "Pitch recording" if recorded.is_run else "Replayed log"
    else:
        beside.refuse_controller("this recording has no attitude")
        sections, summary = stand_sections(recording, recorded.name)
        highlights, title = {}, "Recording"
    return Report(
        title=f"{title}: {recorded.name}",
        summary=summary,
        sections=(*sections, *_behind(recorded), Section("Made with", [Commands(commands)])),
        simulated=recording.simulated,
        made=f"benchtool {__version__}",
        highlights=highlights,
    )


def _pitch_sections(
    recorded: Recorded, beside: Beside
) -> tuple[list[Section], str, dict[str, str]]:
    track = pitch_track(recorded.recording, beside.motors)
    replay: Replay | None = None
    warned = list(track.remarks)
    if beside.model:
        replay, lacks = replayed(track, beside, recorded.provenance)
        warned += lacks
    trace = trace_of(track, replay)
    simulated = recorded.recording.simulated
    caption = (
        "Pitch against its reference, and what else the log holds; green: a rotor is over a "
        f"surface, as in the paper's figures 26 to 30. {_beside_words(replay, beside)}"
    )
    blocks: list[Block] = [
        Warnings(warned),
        FigureBlock(
            replay_figure(trace, title=f"The log: {recorded.name}", simulated=simulated), caption
        ),
    ]
    if trace.over:
        blocks.append(
            FigureBlock(
                closer_figure(trace, title="Closer, over the surface", simulated=simulated),
                f"The same around each green stretch. {_beside_words(replay, beside)}",
            )
        )
        blocks.append(visits_table(track, replay))
    summary = _sentence(track, replay, recorded.name)
    return [Section("The log and its simulated run", blocks)], summary, _highlights(track, replay)


def _beside_words(replay: Replay | None, beside: Beside) -> str:
    if replay is not None:
        return f"Simulated beside it: model {replay.model} on rig {replay.rig}; {replay.words}."
    if beside.model:
        return "No simulated run stands beside it; the warnings say what it lacks."
    return "No model was named, so no simulated run stands beside it (--model)."


def trace_of(track: PitchTrack, replay: Replay | None) -> ReplayTrace:
    """Return a recording and its simulated run in the units of the figure."""
    over = [
        ((float(track.time_s[first]), float(track.time_s[last])), _rotors(track, first, last))
        for first, last in track.visits
    ]
    height = track.distance_m
    if not np.isfinite(height).any() and (track.plate_z_m < PARKED_M).any():
        height = np.where(track.plate_z_m < PARKED_M, track.plate_z_m, np.nan)
    known = {}
    if replay is not None:
        known = {
            "sim_time_s": replay.time_s,
            "sim_pitch_deg": np.degrees(replay.theta_rad),
            "sim_pwm_us": replay.pwm_us,
            "sim_disturbance_mNm": 1e3 * replay.disturbance_Nm
            if np.isfinite(track.disturbance_Nm).any()
            else np.empty(0),
        }
    label = ""
    if replay is not None:
        label = f"simulated, {'closed loop' if replay.by == 'controller' else 'logged pulses'}"
    return ReplayTrace(
        time_s=track.time_s,
        pitch_deg=np.degrees(track.theta_rad),
        reference_deg=np.degrees(track.reference_rad),
        over=over,
        pwm_us=track.pwm_us,
        rpm=track.rpm,
        torque_mNm=1e3 * track.torque_Nm,
        disturbance_mNm=1e3 * track.disturbance_Nm,
        height_m=height,
        sim_label=label or "simulated",
        **known,
    )


def _rotors(track: PitchTrack, first: int, last: int) -> str:
    rotors = track.rotors_over(first, last)
    if len(rotors) == len(track.over) > 1:
        return "all"
    return ", ".join(map(str, rotors))


def errors_deg(track: PitchTrack, replay: Replay | None) -> tuple[Array, Array]:
    """Return pitch errors (n,) of the log and of the simulated run on the log's clock: deg.

    The error is from the reference, or from the log's median where none is logged.
    """
    wanted = track.reference_rad
    if not np.isfinite(wanted).any():
        wanted = np.full(len(track), np.nanmedian(track.theta_rad))
    recorded = np.degrees(track.theta_rad - wanted)
    if replay is None:
        return recorded, np.full(len(track), np.nan)
    at = np.searchsorted(replay.time_s, track.time_s)
    theta = replay.theta_rad[np.minimum(at, len(replay.theta_rad) - 1)]
    theta = np.where(at < len(replay.theta_rad), theta, np.nan)
    return recorded, np.degrees(theta - wanted)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.nanmean(values**2))) if np.isfinite(values).any() else float("nan")


def _peak(values: Array) -> float:
    if not np.isfinite(values).any():
        return float("nan")
    return float(values[int(np.nanargmax(np.abs(values)))])


def _shown(value: float) -> str:
    return f"{value:.2f}".replace("-", "−") if np.isfinite(value) else "–"


def visits_table(track: PitchTrack, replay: Replay | None) -> Table:
    """List the errors of the pitch in each green stretch and outside of all."""
    recorded, simulated = errors_deg(track, replay)
    outside = track.any_over <= 0.0
    stretches = [
        (
            f"{track.time_s[first]:.2f} … {track.time_s[last]:.2f}",
            _rotors(track, first, last),
            np.arange(first, last + 1),
        )
        for first, last in track.visits
    ]
    rows = [
        (
            span,
            rotors,
            _shown(_rms(recorded[part])),
            _shown(_peak(recorded[part])),
            _shown(_rms(simulated[part])),
            _shown(_peak(simulated[part])),
        )
        for span, rotors, part in [*stretches, ("outside of them", "none", np.flatnonzero(outside))]
    ]
    wanted = "reference" if np.isfinite(track.reference_rad).any() else "log's median"
    return Table(
        f"Pitch minus {wanted}, in degrees, positive nose down.",
        ("time [s]", "rotors over it", "RMS", "largest", "simulated RMS", "simulated largest"),
        rows,
        text_columns=2,
    )


def _sentence(track: PitchTrack, replay: Replay | None, name: str) -> str:
    recorded, simulated = errors_deg(track, replay)
    inside = track.any_over > 0.0
    duration_s = len(track) / track.rate_Hz
    words = f"{name}: {duration_s:.4g} s of pitch, RMS error {_rms(recorded):.2f}°"
    if inside.any():
        words += (
            f"; over a surface in {len(track.visits)} "
            f"stretch{'es' if len(track.visits) > 1 else ''} ({inside.sum() / track.rate_Hz:.4g} "
            f"s), there {_rms(recorded[inside]):.2f}° and at most {_peak(recorded[inside]):+.2f}°"
        ).replace("-", "−")
    if replay is not None and np.isfinite(simulated).any():
        part = inside if inside.any() else np.ones(len(track), bool)
        words += f". Simulated with {replay.model}: {_rms(simulated[part]):.2f}°" + (
            " there" if inside.any() else ""
        )
    return words + "."


def _highlights(track: PitchTrack, replay: Replay | None) -> dict[str, str]:
    recorded, simulated = errors_deg(track, replay)
    inside = track.any_over > 0.0
    shown = {"RMS pitch error": f"{_rms(recorded):.2f}°"}
    if inside.any():
        shown = {
            "RMS pitch error, over a surface": f"{_rms(recorded[inside]):.2f}°",
            "elsewhere": f"{_rms(recorded[~inside]):.2f}°",
        }
    if replay is not None:
        part = inside if inside.any() else np.ones(len(track), bool)
        shown["simulated RMS error" + (", over it" if inside.any() else "")] = (
            f"{_rms(simulated[part]):.2f}°"
        )
        if replay.by == "pulses":
            shown["recorded − simulated, RMS"] = f"{_rms(recorded - simulated):.2f}°"
    return shown


def _behind(recorded: Recorded) -> list[Section]:
    facts, recording = recorded.facts, recorded.recording
    if recorded.is_run:
        conditions = state_facts(facts) | air_facts(facts) | calibration_facts(facts)
        hashes = version_facts(facts) | {
            "reported with": f"benchtool {__version__}",
            "sha256 of the run's data (points and samples)": recorded.sha256,
            "sha256 of samples.csv": file_hash(recorded.path / "samples.csv"),
        }
        return [
            Section("Rig and device", [Facts(rig_facts(facts) | device_facts(facts))]),
            Section("Conditions and calibration", [Facts(conditions)]),
            Section("Experiment", [Listing("What was asked (plan.toml).", recorded.plan_text)]),
            Section("Software and data", [Facts(hashes)]),
        ]
    sections = []
    if findings := facts.get("findings"):
        sections.append(Section("Repairs and doubts", _findings(findings, facts)))
    stated = {key: value for key, value in recording.provenance.items() if value}
    ordered = {key: stated[key] for key in MODELLED if key in stated}
    if "file" in stated:
        stated["file"] = Path(stated["file"]).name
    told = ordered | {key: value for key, value in stated.items() if key not in ordered}
    channels = ", ".join(f"{item.name} [{item.unit}]" for item in recording.channels)
    sections.append(
        Section(
            "Where it comes from",
            [
                Facts(
                    told
                    | {
                        "read as": str(facts.get("imported_as", "a recording of benchtool")),
                        "rows": str(len(recording)),
                        "channels": channels,
                    }
                    | _windows(facts)
                )
            ],
        )
    )
    versions = facts.get("versions") or {"benchtool": facts.get("software", "not stated")}
    sections.append(
        Section(
            "Software and data",
            [
                Facts(
                    version_facts({"versions": versions})
                    | {
                        "reported with": f"benchtool {__version__}",
                        f"sha256 of {recorded.name}": recorded.sha256,
                    }
                )
            ],
        )
    )
    return sections


def _windows(facts: Mapping[str, Any]) -> dict[str, str]:
    told = [
        f"{item['start_s']:g} to {item['end_s']:g} s, "
        f"{'all rotors' if not item['rotor'] else 'rotor ' + str(item['rotor'])} ({item['source']})"
        for item in facts.get("windows") or []
    ]
    return {"over a surface": "; ".join(told)} if told else {}


def _findings(findings: Sequence[Mapping[str, Any]], facts: Mapping[str, Any]) -> list[Block]:
    blocks: list[Block] = []
    if tally := facts.get("tally"):
        blocks.append(
            Paragraph(
                f"{tally['total']} {tally['unit']}s in the file: {tally['kept']} kept, "
                f"{tally['refused']} refused, {tally['not_needed']} of kinds that no recording "
                f"needs."
            )
        )
    rows = [
        (item["kind"], item["what"], item.get("channel") or "–", item["words"]) for item in findings
    ]
    blocks.append(
        Table(
            "What was repaired, doubted, refused or found missing while importing.",
            ("kind", "what", "channel", "words"),
            rows,
            text_columns=4,
        )
    )
    return blocks
