"""Effects that a simulated pitch bench may have and its model not: for `explain` to find. Pure."""

from __future__ import annotations

from math import floor, log10

from benchtool.effects.catalogue import candidates
from benchtool.effects.tolerances import default_tolerances
from benchtool.report.numbers import unit_for_people
from benchtool.studies.pitch_setup import pitch_setup
from benchtool.web.simulate.pitch_ask import K_B
from benchtool.web.simulate.slider import Slider

MOST = 12.0
"""Tolerances that the slider of a hidden effect reaches; a choice."""

FIRST = 6.0
"""Tolerances at which it stands at first: enough to show, a choice."""


def hideable() -> dict[str, str]:
    """Return the effects that a pitch bench can hide, name to title; K_b has a slider anyhow."""
    own = K_B.partition(".")[0]
    return {effect.name: effect.title for effect in candidates("pitch") if effect.name != own}


def hidden_slider(rig: str, effect: str) -> Slider:
    """Return the slider of an effect's main parameter, off the value that the rig's model has."""
    model = pitch_setup(rig=rig, controllers=("pid",)).bench.model
    found = next(each for each in candidates("pitch") if each.name == effect)
    tolerance_of = default_tolerances(found, model.rig, "pitch")
    item = next(item for item in found.parameters if item.name in tolerance_of)
    name, tolerance = f"{effect}.{item.name}", tolerance_of[item.name]
    start = model.parameters[name].value if name in model.parameters else item.neutral or 0.0
    step = _round_step(tolerance)
    toward = tolerance if start + MOST * tolerance <= item.upper else -tolerance
    far = start + MOST * toward
    low, high = max(min(start, far), item.lower), min(max(start, far), item.upper)
    return Slider(
        name=name,
        label=f"{found.title} [{unit_for_people(item.unit)}]",
        low=low,
        high=high,
        step=step,
        start=start,
        first=start + FIRST * toward,
    )


def _round_step(tolerance: float) -> float:
    """Return a round number near a fifth of a tolerance."""
    rough = tolerance / 5.0
    power = floor(log10(rough))
    part = max(mark for mark in (1, 2, 5) if mark <= rough / 10.0**power * (1.0 + 1e-9))
    return float(f"{part}e{power}")
