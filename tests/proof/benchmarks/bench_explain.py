"""Explanations: processor time of a verdict with the whole library tried.

The pitch recordings are blind ones (`tests/proof/blind`), 60 s for training and 60 s for validation
at 250 Hz, without a next experiment; the sweep has one. Loops are compiled beforehand.
"""

from __future__ import annotations

from collections.abc import Iterator

from benchtool.explain.engine.explain import explain
from benchtool.explain.pitch.log import pitch_log
from benchtool.explain.pitch.subject import PitchSubject
from benchtool.physics.model_file import load_model
from tests.proof.benchmarks.rows import Row, cpu_s
from tests.proof.blind import score_sweep
from tests.proof.blind.pitch.records import make_record
from tests.proof.blind.score_pitch import MODEL, recording_of
from tests.proof.blind.sweep import records

FAMILIES = {  # family: kind, and the limit in s
    "none": ("no effect", 3.0),
    "coulomb_friction": ("one effect", 6.0),
    "plate_offset": ("one effect", 6.0),
    "cog_offset+motor_lag": ("a pair", 8.0),
    "arm_flexure": ("an unknown effect", 20.0),
}


def pitch_subject(family: str, blocks: int) -> PitchSubject:
    """Return a blind record with parts of so many blocks of 30 s."""
    record = make_record(7000, family, excitation="rich", blocks=blocks)
    model = load_model(MODEL).model
    learn, check = (
        pitch_log(recording_of(table, name), model.rig, name)
        for table, name in ((record.learn, "learn"), (record.check, "check"))
    )
    return PitchSubject(model, [learn], [check])


def rows(quick: bool) -> Iterator[Row]:
    """Yield one row for each family, and one for a sweep."""
    if not quick:
        explain(pitch_subject("none", 1), propose=False)
    for family, (kind, limit_s) in list(FAMILIES.items())[: 1 if quick else None]:
        subject = pitch_subject(family, 1 if quick else 2)
        used_s = cpu_s(lambda: explain(subject, propose=False))  # noqa: B023
        yield Row(f"explain 60 s, {kind}: {family}", used_s, "s", wanted=limit_s)
    record = records.make_record(7000, "body_lift", excitation="rich")
    used_s = cpu_s(lambda: score_sweep.verdict_on(record))
    yield Row("explain a sweep, with its next experiment", used_s, "s", wanted=2.0)
