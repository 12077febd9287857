"""An answer as JSON for programs; docs/reference/explain-json.md documents it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from benchtool import __version__
from benchtool.data.atomic import json_ready
from benchtool.explain.answer import Answer
from benchtool.explain.engine.verdict import ChannelGap, FoundParameter, NamedEffect
from benchtool.explain.next_steps import next_file
from benchtool.report.answer.tables import unjudged_sentence

VERSION = 2
"""Counts up when a key changes its meaning or goes; new keys may come without."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Written:
    """Name the files beside an answer, as paths; empty where there is none.

    Attributes:
        model: the new model file.
        schedule: of the next experiment.
    """

    model: str = ""
    schedule: str = ""


def answer_tables(answer: Answer, written: Written) -> dict[str, Any]:
    """Return the contents of the JSON file: every key is always there."""
    verdict = answer.verdict
    where, nearest = verdict.where, verdict.nearest
    tables = {
        "version": VERSION,
        "verdict": verdict.kind,
        "sentence": verdict.sentence,
        "effects": [_effect(effect) for effect in verdict.effects],
        "class": list(verdict.names) if verdict.kind == "class" else [],
        "probabilities": dict(verdict.probabilities),
        "places": [
            {"effect": place.effect, "probabilities": dict(place.probabilities)}
            for place in verdict.places
        ],
        "where": {
            "stage": where.stage if where else None,
            "regime": where.regime if where else None,
            "size": where.size if where else None,
            "share": where.share if where else None,
        },
        "gap": {gap.channel: _gap(gap) for gap in verdict.gaps},
        "nearest": {
            "name": nearest.name if nearest else None,
            "share_closed": nearest.share_closed if nearest else None,
        },
        "tolerances": dict(verdict.tolerances),
        "not_judged": {
            name: {
                "reason": one.reason,
                "tolerances_needed": one.size,
                "sentence": unjudged_sentence(answer, name),
            }
            for name, one in verdict.not_judged.items()
        },
        "remarks": list(answer.remarks),
        "next_experiment": _next(answer, written.schedule),
        "model_out": written.model or None,
        "seconds": answer.seconds,
        "bench": verdict.bench,
        "window_s": verdict.window_s,
        "draws": verdict.draws,
        "seed": answer.seed,
        "simulated": answer.simulated,
        "model": answer.request.loaded.model.name,
        "data": {
            "learn": {source.name: source.sha256 for source in answer.request.learn},
            "check": {source.name: source.sha256 for source in answer.request.check},
        },
        "software": f"benchtool {__version__}",
    }
    cleaned: dict[str, Any] = json_ready(tables)
    return cleaned


def _next(answer: Answer, path: str) -> dict[str, Any]:
    experiment = answer.verdict.next
    if experiment is None:
        return dict.fromkeys(("candidates", "title", "reason", "kind", "file", "text", "expected"))
    return {
        "candidates": list(experiment.candidates),
        "title": experiment.title,
        "reason": experiment.reason,
        "kind": "schedule" if experiment.schedule is not None else "plan",
        "file": path or None,
        "text": next_file(answer)[1],
        "expected": dict(experiment.expected),
    }


def _effect(effect: NamedEffect) -> dict[str, Any]:
    return {
        "name": effect.name,
        "title": effect.title,
        "stage": effect.stage,
        "probability": effect.probability,
        "parameters": {item.name: _parameter(item) for item in effect.parameters},
        "log_likelihood_ratio": effect.log_likelihood_ratio,
        "p_value": effect.p_value,
    }


def _parameter(item: FoundParameter) -> dict[str, Any]:
    return {
        "value": item.value,
        "std": item.std,
        "unit": item.unit,
        "interval_95": [item.low, item.high],
        "tolerance": item.tolerance,
        "neutral": item.neutral,
    }


def _gap(gap: ChannelGap) -> dict[str, Any]:
    return {
        "unit": gap.unit,
        "before": gap.before,
        "after": gap.after,
        "floor": gap.floor,
        "floor_5_95": [gap.floor_low, gap.floor_high],
        "before_95": [gap.before_low, gap.before_high],
        "after_95": [gap.after_low, gap.after_high],
        "as_given": gap.as_given,
        "share_closed": gap.share_closed,
    }
