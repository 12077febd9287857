"""Score `benchtool explain` on pitch records with hidden effects, and print the scorecard.

`make blind` runs it on scoring seeds. Every record's outcome is kept in a file beside the others,
so that a run that was cut short goes on where it was.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchtool.core.channel import Channel
from benchtool.core.recording import Recording
from benchtool.explain.engine.evidence import with_every_effect
from benchtool.explain.engine.explain import explain
from benchtool.explain.pitch.log import PitchLog, pitch_log
from benchtool.explain.pitch.subject import PitchSubject
from benchtool.explain.result import Explanation
from benchtool.physics.model_file import load_model
from tests.proof.blind.pitch.gap import floor_of
from tests.proof.blind.pitch.information import information
from tests.proof.blind.pitch.library import NAMED
from tests.proof.blind.pitch.outside import OUTSIDE
from tests.proof.blind.pitch.records import HiddenRecord, make_record
from tests.proof.blind.scored import Scored
from tests.proof.blind.scoring import Asked, plan, run, score, single_effects

MODEL = Path(__file__).resolve().parents[3] / "datasets" / "pitch_bench" / "model.toml"

OURS = {
    "t": ("time_s", "s"), "theta_ref": ("theta_ref_rad", "rad"), "theta": ("theta_rad", "rad"),
    "gyro": ("gyro_rad_s", "rad/s"), "pwm1": ("pwm1_us", "us"), "pwm2": ("pwm2_us", "us"),
    "rpm1": ("rpm1", "rpm"), "rpm2": ("rpm2", "rpm"), "plate_z": ("plate_z_m", "m"),
}  # fmt: skip

OUTSIDE_STAGE = {
    "esc_steps": "pwm_to_rpm", "stribeck_hysteresis": "hinge", "shifting_load": "hinge",
    "arm_flexure": "hinge", "encoder_backlash": "", "thrust_lean": "",
}  # fmt: skip

SIGN = {"cog_offset": -1.0}
"""The generator counts towards rotor 1, which stands behind the hinge of benchtool's beam."""


def asked(first_seed: int, scale: float, length: int = 0) -> Iterator[Asked]:
    """Yield what is scored."""
    if length:
        return single_effects(NAMED, first_seed, length, scale=scale)
    return plan(NAMED, OUTSIDE, first_seed, scale=scale)


def recording_of(record_part: object, name: str) -> Recording:
    """Return one table of a record in benchtool's channels."""
    columns = [
        (Channel(*OURS[column]), record_part[column].to_numpy(float))  # type: ignore[index]
        for column in OURS
    ]
    return Recording.from_columns(columns, {"file": name})


def _log(table: object, name: str) -> PitchLog:
    """Return one table of a record as the bench's owner would hand it in."""
    loaded = load_model(MODEL)
    recording = recording_of(table, name)
    return pitch_log(recording, loaded.model.rig, name, loaded.plate_slide_s)


def _gaps_truly(record: HiddenRecord, verdict: Explanation) -> dict[str, float]:
    """Return the gap over the floor of the verdict's model with the wake as strong as it truly is.

    Nothing where that wake asks for windows of another length.
    """
    plant = record.truth.plant
    model = with_every_effect(load_model(MODEL).model, "pitch").with_values(verdict.parameters)
    model = model.with_fixed("wake_torque.sd_Nm", plant.wake_sd_Nm)
    model = model.with_fixed("wake_torque.correlation_s", plant.wake_tau_s)
    check = [_log(record.check, "check")]
    subject = PitchSubject(model, check, check)
    if subject.window_s != verdict.window_s:
        return {}
    as_given = np.zeros(len(subject.evidence.parameters))
    nothing = np.zeros((1, verdict.draws))
    floors = subject.floor(as_given, nothing, np.random.default_rng(0))
    return {gap.channel: gap.after / float(np.median(floors[gap.channel])) for gap in verdict.gaps}


def verdict_on(record: HiddenRecord) -> tuple[Explanation, float]:
    """Return the explanation of a record, and how long it took: s."""
    model = load_model(MODEL).model
    logs = [_log(record.learn, "learn"), _log(record.check, "check")]
    began = time.perf_counter()
    found = explain(PitchSubject(model, logs[:1], logs[1:]), propose=False)
    return found, time.perf_counter() - began


def scored(one: Asked) -> Scored:
    """Make a record and score the verdict on it."""
    record = make_record(
        one.seed,
        one.family,
        excitation=one.excitation,
        strength=one.strength,
        blocks=one.length,
    )
    found, seconds = verdict_on(record)
    truth = record.truth
    more: dict[str, object] = {}
    if truth.kind == "outside":
        more["stage"] = OUTSIDE_STAGE.get(one.family, "")
    if truth.kind == "named" and one.strength == "full" and one.excitation == "rich":
        missed = floor_of(record.parts[1], truth.plant, found.window_s)
        floors = {gap.channel: gap.floor for gap in found.gaps}
        more["gaps_truly"] = _gaps_truly(record, found)
        more["true_gaps"] = {
            "theta_rad": missed["theta"] / floors["theta_rad"],
            "gyro_rad_s": missed["gyro"] / floors["gyro_rad_s"],
        }
    hidden = {
        f"{effect.name}.{effect.parameter}": SIGN.get(effect.name, 1.0) * effect.value
        for effect in truth.effects
    }
    return score(
        one,
        truth,
        found,
        seconds,
        hidden,
        lambda: information(record.parts[0], truth.plant),
        **more,
    )


if __name__ == "__main__":
    run(
        "Pitch bench",
        asked,
        scored,
        Path("build/blind_pitch.jsonl"),
        about="A rigid-body engine with rotors, friction and sensors of our own; nothing of the "
        "library's formulae. Nothing was chosen on scoring seeds.",
    )
