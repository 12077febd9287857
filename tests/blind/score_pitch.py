"""Score `benchtool explain` on pitch records with hidden effects, and print the scorecard.

`make blind` runs it on scoring seeds. Every record's outcome is kept in a file beside the others,
so that a run that was cut short goes on where it was.
"""

from __future__ import annotations

import argparse
import datetime as dt
import json
import os
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from benchtool.core.channel import Channel
from benchtool.core.recording import Recording
from benchtool.effects.catalogue import EFFECTS
from benchtool.explain.explain import explain
from benchtool.explain.pitch_log import pitch_log
from benchtool.explain.pitch_subject import PitchSubject
from benchtool.explain.verdict import Verdict
from benchtool.library import load_model
from tests.blind.families import NONE, PAIR
from tests.blind.pitch.gap import miss
from tests.blind.pitch.information import information
from tests.blind.pitch.library import NAMED
from tests.blind.pitch.outside import OUTSIDE
from tests.blind.pitch.records import HiddenRecord, make_record
from tests.blind.pitch.seeds import DEVELOPMENT_SEEDS, SCORING_SEEDS, SCORING_SWITCH
from tests.blind.scorecard import Scorecard
from tests.blind.scored import Scored, ScoredParameter

MODEL = Path(__file__).resolve().parents[2] / "datasets" / "pitch_bench" / "model.toml"

OURS = {
    "t": ("time_s", "s"), "theta_ref": ("theta_ref_rad", "rad"), "theta": ("theta_rad", "rad"),
    "gyro": ("gyro_rad_s", "rad/s"), "pwm1": ("pwm1_us", "us"), "pwm2": ("pwm2_us", "us"),
    "rpm1": ("rpm1", "rpm"), "rpm2": ("rpm2", "rpm"), "plate_z": ("plate_z_m", "m"),
}  # fmt: skip

OUTSIDE_STAGE = {
    "esc_steps": "pwm_to_rpm", "stribeck_hysteresis": "hinge", "shifting_load": "hinge",
    "arm_flexure": "hinge", "encoder_backlash": "", "thrust_lean": "",
}  # fmt: skip

CANNOT_TELL = 25.0
"""Twice the log-likelihood ratio that the truth has on average over a rival, by the true model's
own information, below which a class of the two is an honest answer."""


@dataclass(frozen=True, slots=True)
class Asked:
    """Ask for one record."""

    seed: int
    family: str
    strength: str = "full"
    excitation: str = "rich"

    @property
    def label(self) -> str:
        """Find the record again by this."""
        return f"{self.family} {self.strength} {self.excitation} {self.seed}"


def plan(first_seed: int, scale: float = 1.0) -> Iterator[Asked]:
    """Yield what is scored: every kind in turn, so that a part of it is a fair sample."""

    def count(full: int) -> int:
        return max(1, round(full * scale))

    seed = first_seed
    for part in range(count(16)):
        for name in NAMED:
            yield Asked(seed, name)
            if part % 8 < 3:
                yield Asked(seed, name, excitation="poor")
            if part % 8 < 3:
                yield Asked(seed, name, strength="weak")
        for k in range(count(19)):
            yield Asked(seed + k, NONE)
        for name in OUTSIDE:
            if part % 8 < 5:
                yield Asked(seed, name)
        for k in range(3):
            yield Asked(seed + k, PAIR)
        seed += 20


def recording_of(record_part: object, name: str) -> Recording:
    """Return one table of a record in benchtool's channels."""
    columns = [
        (Channel(*OURS[column]), record_part[column].to_numpy(float))  # type: ignore[index]
        for column in OURS
    ]
    return Recording.from_columns(columns, {"file": name})


def verdict_on(record: HiddenRecord) -> tuple[Verdict, float]:
    """Return the verdict on a record, and how long it took: s."""
    model = load_model(MODEL).model
    logs = [
        pitch_log(recording_of(table, name), model.rig, name)
        for table, name in ((record.learn, "learn"), (record.check, "check"))
    ]
    began = time.perf_counter()
    verdict = explain(PitchSubject(model, logs[:1], logs[1:])).verdict
    return verdict, time.perf_counter() - began


def scored(asked: Asked) -> Scored:
    """Make a record and score the verdict on it."""
    record = make_record(
        asked.seed,
        asked.family,
        excitation=asked.excitation,
        strength=asked.strength,  # type: ignore[arg-type]
    )
    verdict, seconds = verdict_on(record)
    truth = record.truth
    hidden = {effect.name: effect for effect in truth.effects}
    stage = (
        EFFECTS[truth.names[0]].stage
        if truth.kind == "named"
        else (OUTSIDE_STAGE.get(asked.family, "") if truth.kind == "outside" else "")
    )
    floors = {gap.channel: gap.floor for gap in verdict.gaps}
    true_gaps: dict[str, float] = {}
    if truth.kind == "named" and asked.strength == "full" and asked.excitation == "rich":
        missed = miss(record.parts[1], truth.plant, truth.plant)
        true_gaps = {
            "theta_rad": missed["theta"] / floors["theta_rad"],
            "gyro_rad_s": missed["gyro"] / floors["gyro_rad_s"],
        }
    confirmed = False
    if verdict.kind == "class" and set(verdict.names) & set(truth.names):
        told = information(record.parts[0], truth.plant)
        rivals = [name for name in verdict.names if name not in truth.names]
        confirmed = all(told.evidence([rival]) < CANNOT_TELL for rival in rivals)
    return Scored(
        kind=truth.kind,
        truth=truth.names,
        sizes=tuple(effect.size for effect in truth.effects),
        stage=stage,
        verdict=verdict.kind,
        names=verdict.names,
        probabilities=dict(verdict.probabilities),
        where=verdict.where.stage if verdict.where is not None else "",
        not_judged=tuple(verdict.not_judged),
        confirmed=confirmed,
        gaps={gap.channel: gap.after / gap.floor for gap in verdict.gaps},
        true_gaps=true_gaps,
        parameters=tuple(
            ScoredParameter(
                name=f"{effect.name}.{item.name}", value=item.value, low=item.low, high=item.high,
                truth=hidden[effect.name].value,
            )
            for effect in verdict.effects
            if effect.name in hidden
            for item in effect.parameters
            if item.name == hidden[effect.name].parameter
        ),
        seconds=seconds,
        strength=asked.strength,  # type: ignore[arg-type]
        excitation=asked.excitation,  # type: ignore[arg-type]
        label=asked.label,
    )  # fmt: skip


def read(path: Path) -> dict[str, Scored]:
    """Return what was scored before, by label."""
    if not path.exists():
        return {}
    found = {}
    for line in path.read_text(encoding="utf-8").splitlines():
        data = json.loads(line)
        data["parameters"] = tuple(ScoredParameter(**one) for one in data["parameters"])
        for name in ("truth", "sizes", "names", "not_judged"):
            data[name] = tuple(data[name])
        found[data["label"]] = Scored(**data)
    return found


def main() -> None:
    """Score, print, and write the page when asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scoring", action="store_true", help="scoring seeds, not development's")
    parser.add_argument("--scale", type=float, default=1.0, help="part of the records to make")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--kept", type=Path, default=Path("build/blind_pitch.jsonl"))
    parser.add_argument("--page", type=Path, default=None, help="Markdown file to write")
    given = parser.parse_args()
    if given.scoring:
        os.environ[SCORING_SWITCH] = "1"
    first = (SCORING_SEEDS if given.scoring else DEVELOPMENT_SEEDS).start
    first += 0 if given.scoring else 2000
    given.kept.parent.mkdir(parents=True, exist_ok=True)
    done = read(given.kept)
    asked = [one for one in plan(first, given.scale) if one.label not in done]
    print(f"{len(done)} records were scored before, {len(asked)} are to be", flush=True)
    with (
        ProcessPoolExecutor(given.workers) as pool,
        given.kept.open("a", encoding="utf-8") as kept,
    ):
        for count, one in enumerate(pool.map(scored, asked), 1):
            done[one.label] = one
            kept.write(json.dumps(asdict(one), default=_plain) + "\n")
            kept.flush()
            if count % 20 == 0:
                print(f"{count} of {len(asked)}", flush=True)
    card = Scorecard("Pitch bench", list(done.values()))
    print(card.text())
    if given.page is not None:
        today = dt.datetime.now(tz=dt.UTC).date().isoformat()
        given.page.write_text(card.markdown(today), encoding="utf-8")


def _plain(value: object) -> object:
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{value!r} cannot be kept")


if __name__ == "__main__":
    main()
