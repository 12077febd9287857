"""Print what an explanation of a pitch recording costs; the aim: 10 s for 60 s at 250 Hz.

The recordings are blind ones (`tests/proof/blind`), 60 s to learn from and 60 s to check on, with
the whole library tried, on one core; the next experiment is not worked out. Compiled loops are made
beforehand, as on every run but the first.
"""

from __future__ import annotations

import time

from benchtool.explain.engine.explain import explain
from benchtool.explain.pitch.log import pitch_log
from benchtool.explain.pitch.subject import PitchSubject
from benchtool.physics.model_file import load_model
from tests.proof.blind.pitch.records import make_record
from tests.proof.blind.score_pitch import MODEL, recording_of

FAMILIES = ("none", "coulomb_friction", "plate_offset", "arm_flexure", "cog_offset+motor_lag")


def seconds(family: str, blocks: int) -> tuple[float, str]:
    """Return a core's time for the verdict on one record, in s, and the verdict."""
    record = make_record(7000, family, excitation="rich", blocks=blocks)
    model = load_model(MODEL).model
    learn, check = (
        pitch_log(recording_of(table, name), model.rig, name)
        for table, name in ((record.learn, "learn"), (record.check, "check"))
    )
    began = time.process_time()
    verdict = explain(PitchSubject(model, [learn], [check]), propose=False)
    return time.process_time() - began, " and ".join((verdict.kind, *verdict.names))


if __name__ == "__main__":
    seconds("none", 1)
    for family in FAMILIES:
        spent, verdict = seconds(family, 2)
        print(f"{family:22s} 60 s at 250 Hz: {spent:5.1f} s  ({verdict})")
