"""Explanations made by hand, for what comes after the decision."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchtool.core.channel import Channel
from benchtool.core.parameter import Parameters
from benchtool.core.recording import Recording
from benchtool.core.schedule import PlateVisit, Schedule, Signal
from benchtool.explain.engine.design import CandidateEffect
from benchtool.explain.engine.evidence import Evidence
from benchtool.explain.engine.hypotheses import Hypothesis
from benchtool.explain.findings import (
    AlternativeEffects,
    ChannelGap,
    Disagreement,
    EvidenceLocation,
    FoundParameter,
    NamedEffect,
    NearestEffect,
    NextExperiment,
    Overlay,
    UnjudgedEffect,
)
from benchtool.explain.inputs import ExplainInputs
from benchtool.explain.request import RecordingSource, Request
from benchtool.explain.result import Explanation, Kind
from benchtool.physics.catalogue import EFFECTS
from benchtool.physics.model_file import LoadedModel, load_model
from benchtool.physics.tolerances import model_tolerances

MODEL = Path(__file__).parents[3] / "datasets" / "pitch_bench" / "model.toml"

FRICTION = NamedEffect(
    name="coulomb_friction",
    title="Coulomb friction",
    phrase="Coulomb friction",
    stage="hinge",
    probability=0.984,
    parameters=(
        FoundParameter(
            name="torque_Nm", unit="N m", value=0.0241, std=0.0006, low=0.0229, high=0.0253,
            tolerance=0.002, neutral=0.0,
        ),
    ),
    log_likelihood_ratio=512.3,
    p_value=1e-30,
)  # fmt: skip

OFFSET = NamedEffect(
    name="cog_offset",
    title="Centre-of-gravity offset",
    phrase="centre-of-gravity offset",
    stage="hinge",
    probability=0.6,
    parameters=(
        FoundParameter(
            name="x_m", unit="m", value=-0.0014, std=0.0001, low=-0.0016, high=-0.0012,
            tolerance=0.0005, neutral=0.0,
        ),
    ),
    log_likelihood_ratio=41.0,
    p_value=3e-11,
)  # fmt: skip

PROBABILITIES = {"coulomb_friction": 0.984, "cog_offset": 0.004, "none": 1e-40, "unknown": 0.012}

SECOND = AlternativeEffects(
    effect="cog_offset",
    probabilities={"cog_offset": 0.6, "rotor_asymmetry": 0.387, "none": 1e-3, "unknown": 0.012},
)

NEXT = NextExperiment(
    candidates=("coulomb_friction", "cog_offset"),
    title="Attitude steps at three collectives, 20 s",
    reason="a torque that grows with the collective comes from the rotors",
    schedule=Schedule(
        name="next_collectives",
        title="Steps of the attitude at three collectives",
        duration_s=20.0,
        reference_deg=(Signal(shape="steps", levels=(0.0, 5.0, -5.0), every_s=2.5),),
        collective=(Signal(shape="steps", levels=(0.0, 0.1, -0.1), every_s=5.0),),
        plate=(PlateVisit(z_over_R=2.0, in_s=4.0, out_s=9.0),),
    ),
    plan_toml="",
    expected={"cog_offset": 40.0},
    minutes=0.3,
)


def gap(channel: str, unit: str, before: float, after: float, floor: float) -> ChannelGap:
    """Make a gap whose intervals are a tenth of it on each side."""
    return ChannelGap(
        channel=channel, unit=unit, as_given=1.2 * before, before=before, after=after, floor=floor,
        floor_low=0.85 * floor, floor_high=1.2 * floor, before_low=0.9 * before,
        before_high=1.1 * before, after_low=0.9 * after, after_high=1.1 * after,
    )  # fmt: skip


def verdict(kind: Kind = "effect", **changes: Any) -> Explanation:
    """Make an explanation of that kind about the pitch bench, of recordings in memory."""
    model = load_model(MODEL).model
    known = Parameters(
        (name, item.with_value(0.0309) if name == "inertia_kgm2" else item)
        for name, item in model.parameters.items()
    )
    before, turning = (0.0055, 0.025) if kind == "none" else (0.016, 0.071)
    effects = {
        "effect": (FRICTION,), "several": (FRICTION, OFFSET), "class": (FRICTION, OFFSET),
    }.get(kind, ())  # fmt: skip
    named = bool(effects)
    given = Explanation(
        kind=kind,
        bench="pitch",
        effects=effects,
        probabilities=PROBABILITIES,
        alternatives=(
            AlternativeEffects(effect="coulomb_friction", probabilities=PROBABILITIES),
            *((SECOND,) if kind == "several" else ()),
        ),
        where=None if kind == "none" else EvidenceLocation(
            stage="hinge", regime="slow reversals", size=3.4, share=0.71
        ),
        gaps=(
            gap("theta_rad", "rad", before, 0.0055 if named else before, 0.0052),
            gap("gyro_rad_s", "rad/s", turning, 0.025 if named else turning, 0.023),
            gap("rpm", "rpm", 31.0, 30.0 if named else 31.0, 29.0),
        ),
        nearest=NearestEffect(
            effect=FRICTION, share_closed=0.61, parameters=known,
            after={"theta_rad": 0.011, "gyro_rad_s": 0.045, "rpm": 31.0},
        ) if kind == "unknown" else None,
        tolerances=model_tolerances(model, "pitch"),
        unnamed=(),
        other_effects={},
        not_judged={"partial_coverage": UnjudgedEffect(reason="too_weak", size=4.2)},
        remarks=("learn.csv: 2 gaps in time, the first at 3.100 s; judged in parts",),
        next=NEXT if kind in ("class", "unknown") else None,
        parameters=known,
        window_s=1.0,
        draws=128,
    )  # fmt: skip
    return replace(given, **changes)


def curves(named: bool) -> dict[str, Any]:
    """Return the curves behind a verdict."""
    rng = np.random.default_rng(3)
    at = np.arange(0.0, 12.0, 0.004)
    at[::250] = np.nan
    t = np.nan_to_num(at)
    true = 0.17 * np.sin(1.3 * t)
    before = true + 0.015 * np.sin(2.0 * t) * (t > 4.0)
    after = true + 0.002 * np.sin(3.0 * t)
    parts = {"everywhere": 1.9, "slow reversals": 3.4, "at rest": 2.2, "fast motion": 1.1}
    return {
        "overlays": (
            Overlay(
                channel="theta_rad", unit="rad", axis="time_s", at=at,
                measured=true + 0.002 * rng.standard_normal(len(t)), before=before,
                after=after if named else before,
            ),
        ),
        "disagreements": (
            Disagreement(
                stage="hinge", by_regime=parts,
                after=dict.fromkeys(parts, 1.05) if named else parts,
            ),
            Disagreement(
                stage="pwm_to_rpm", by_regime=dict.fromkeys(parts, 1.01),
                after=dict.fromkeys(parts, 1.01),
            ),
        ),
    }  # fmt: skip


def far_off(evidence: Evidence, name: str, tolerances: float) -> CandidateEffect:
    """Make a rival in which an effect's numbers are so many tolerances from neutral."""
    at = np.array([tolerances * (one.effect == name) for one in evidence.parameters])
    fit = Hypothesis(
        active=(name,), values=at, linearisation_point=at, cost=0.0, converged=True, amplitudes={}
    )
    return CandidateEffect(name=name, phrase=EFFECTS[name].phrase, fit=fit, probability=0.5)


def source(path: str, sha256: str) -> RecordingSource:
    """Make a recording of three rows."""
    recording = Recording.from_columns(
        [(Channel("time_s", "s"), np.arange(3.0)), (Channel("theta_rad", "rad"), np.zeros(3))]
    )
    return RecordingSource(path=path, name=path, recording=recording, sha256=sha256)


def answer(kind: Kind = "effect", loaded: LoadedModel | None = None, **changes: Any) -> Explanation:
    """Make an answer of that kind about the pitch bench, of recordings in files."""
    request = Request(
        inputs=ExplainInputs(model="model.toml"),
        loaded=loaded or load_model(MODEL),
        model_file="model.toml",
        model_sha256="c0ffee",
        effects_file=None,
        user_effects=(),
        learn=(source("learn.csv", "1" * 64),),
        check=(source("check.csv", "2" * 64),),
    )
    asked = {name: changes.pop(name) for name in [*changes] if hasattr(request, name)}
    given = verdict(kind)
    assert all(name in EFFECTS for name in given.names)
    given = replace(
        given,
        source=replace(request, **asked),
        seconds=4.2,
        commands=("benchtool explain learn.csv --model model.toml --check check.csv",),
        **curves(bool(given.effects)),
    )
    return replace(given, **changes)
