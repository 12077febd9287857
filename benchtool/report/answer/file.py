"""An answer as JSON for programs; docs/reference/explain-json.md documents it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from benchtool import __version__
from benchtool.data.atomic import json_ready
from benchtool.explain.answer import Answer
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
    tables = {
        "version": VERSION,
        "verdict": verdict.kind,
        "sentence": verdict.sentence,
        "effects": [
            asdict(effect)
            | {
                "parameters": {
                    item.name: _fields(item, "value", "std", "unit", interval_95="")
                    | _fields(item, "tolerance", "neutral")
                    for item in effect.parameters
                }
            }
            for effect in verdict.effects
        ],
        "class": list(verdict.names) if verdict.kind == "class" else [],
        "probabilities": dict(verdict.probabilities),
        "places": [_fields(place, "effect", "probabilities") for place in verdict.places],
        "where": _fields(verdict.where, "stage", "regime", "size", "share"),
        "gap": {
            gap.channel: _fields(
                gap, "unit", "before", "after", "floor",
                floor_5_95="floor_", before_95="before_", after_95="after_",
            ) | _fields(gap, "as_given", "share_closed")
            for gap in verdict.gaps
        },
        "nearest": _fields(verdict.nearest, "name", "share_closed"),
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
        **_fields(verdict, "bench", "window_s", "draws"),
        **_fields(answer, "seed", "simulated"),
        "model": answer.request.loaded.model.name,
        "data": {
            "learn": {source.name: source.sha256 for source in answer.request.learn},
            "check": {source.name: source.sha256 for source in answer.request.check},
        },
        "software": f"benchtool {__version__}",
    }  # fmt: skip
    cleaned: dict[str, Any] = json_ready(tables)
    return cleaned


def _fields(item: Any, *names: str, **spans: str) -> dict[str, Any]:
    """Return attributes, None of no item, and pairs of those whose names end in low and high."""
    found = {name: getattr(item, name, None) for name in names}
    pairs = {
        key: [getattr(item, f"{stem}low"), getattr(item, f"{stem}high")]
        for key, stem in spans.items()
    }
    return found | pairs


def _next(answer: Answer, path: str) -> dict[str, Any]:
    experiment = answer.verdict.next
    kind = None if experiment is None else "schedule" if experiment.schedule is not None else "plan"
    return {
        **_fields(experiment, "candidates", "title", "reason"),
        "kind": kind,
        "file": path or None,
        "text": None if experiment is None else next_file(answer)[1],
        **_fields(experiment, "expected"),
    }
